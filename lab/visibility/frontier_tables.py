"""Tables of what layouts show and what is read from them, for docs and the page of evaluate.py."""

from pathlib import Path

from reports.render.tables import Table, TableCell, percent, share_interval
from reports.visibility.frontier_results import PAPER_HZ, FrontierResults, Lead, read_frontier


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


def close_table(results: FrontierResults) -> Table | None:
    """Tabulate where `learned` is not clearly ahead of another method; None where it always is."""
    rows: list[list[str | TableCell]] = []
    for result in results.settings:
        for row in sorted(result.read, key=lambda row: row.view_deg):
            if row.lead is not None and row.lead.low <= 0:
                ours = next(
                    own.accuracy
                    for own in result.read
                    if (own.method, own.view_deg) == ("learned", row.view_deg)
                )
                name, view = result.setting.name, f"{row.view_deg:g}°"
                right = [percent(ours), percent(row.accuracy)]
                rows.append([name, view, row.method, *right, _lead_cell(row.lead)])
    heads = ["setting", "view", "method", "learned right %", "method right %", "points ahead"]
    title = "Where learned is not clearly ahead: the interval of its lead reaches 0 or below"
    return Table(heads, rows, title, left=3) if rows else None


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
                    "–" if rate.jod is None else f"{rate.jod:.2f}",
                    f"{carried:,.0f}",
                    f"{rate.seen / seen:.2f}",
                    f"{carried / bits_hz:.1f}" if bits_hz else "–",
                ]
            )
    heads = ["setting", "states/s", "contrast over threshold", "PSNR dB", "JOD", "bits/s",
             "× seen of the paper's", "× bits/s of the paper's"]  # fmt: skip
    return Table(heads, rows)


def frontier_blocks(file: Path) -> dict[str, str]:
    """Make the blocks of docs/hidden.md by name.

    Args:
        file: what `write_frontier` wrote.
    """
    results = read_frontier(file)
    rows = [row for result in results.settings for row in result.read]
    each = ", ".join(str(count) for count in sorted({row.frames for row in rows}))
    how = f"Seed {results.meta['seed']}, {each} frame pairs at each view, simulated."
    tables = {"hidden_bits": bits_table(results), "hidden_rates": rate_table(results)}
    return {name: f"{how}\n\n{table.markdown()}" for name, table in tables.items()}
