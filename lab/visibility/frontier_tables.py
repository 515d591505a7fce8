"""Tables of what layouts show and what is read from them."""

from collections.abc import Mapping

from lab.study import Results
from lab.visibility.frontier_results import PAPER_HZ, FrontierResults, Lead
from reports.render.tables import Table, TableCell, percent, share_interval


def bits_table(results: FrontierResults) -> Table:
    """Tabulate right bits by setting, view and method, and how far `learned` is ahead."""
    rows = [
        [
            result.setting.name,
            f"{row.view_deg:g}°",
            row.method,
            percent(row.accuracy),
            share_interval(row.ci_low, row.ci_high),
            f"{row.bits - row.correct:,} of {row.bits:,}",
            f"{result.message_bits * max(0.0, row.information):,.0f}",
            _lead_cell(row.lead),
        ]
        for result in results.settings
        for row in sorted(result.read, key=lambda row: row.view_deg)
    ]
    heads = ["setting", "view", "method", "right bits %", "95 % interval", "wrong",
             "bits a frame pair", "learned ahead, points"]  # fmt: skip
    return Table(heads, rows, left=3)


def _lead_cell(lead: Lead | None) -> str | TableCell:
    """Show a lead: green where its interval lies above 0, red where it does not."""
    if lead is None:
        return "–"
    interval = f"{lead.low:+.2f} to {lead.high:+.2f}"
    return TableCell(f"{lead.points:+.2f}", interval, "good" if lead.low > 0 else "bad")


def rate_table(results: FrontierResults) -> Table:
    """Tabulate visibility and bits a second, and both against the paper's setting."""
    paper = results.paper
    seen, bits_hz = paper.seen_at(PAPER_HZ), paper.bits_a_pair * PAPER_HZ / 2
    rows = []
    for result in results.settings:
        for rate in result.shown:
            carried = result.bits_a_pair * rate.states_hz / 2
            rows.append(
                [
                    result.setting.name,
                    str(rate.states_hz),
                    f"{rate.seen:.2f}",
                    f"{result.psnr:.1f}",
                    f"{carried:,.0f}",
                    f"{rate.seen / seen:.2f}",
                    f"{carried / bits_hz:.1f}" if bits_hz else "–",
                ]
            )
    heads = ["setting", "states/s", "contrast over threshold", "PSNR dB", "bits/s",
             "× seen of the paper's", "× bits/s of the paper's"]  # fmt: skip
    return Table(heads, rows)


def frontier_blocks(stored: Mapping[str, Results[FrontierResults]]) -> dict[str, str]:
    """Show right bits, and bits a second, by the name of the page's block."""
    meta, results = stored["frontier"].meta, stored["frontier"].content
    rows = [row for result in results.settings for row in result.read]
    each = ", ".join(str(count) for count in sorted({row.frames for row in rows}))
    how = f"Seed {meta['seed']}, {each} frame pairs at each view, simulated."
    tables = {"hidden_bits": bits_table(results), "hidden_rates": rate_table(results)}
    return {name: f"{how}\n\n{table.markdown()}" for name, table in tables.items()}
