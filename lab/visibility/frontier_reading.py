"""What methods read of a setting: rows of the stored results, from a table of predictions."""

import numpy as np
import pandas as pd

from lab.visibility.frontier_results import Lead, ReadRow
from reports.engine.methods import METHODS
from reports.score.accuracy import pool, score
from reports.score.paired import compare_methods
from reports.score.reliability import decided_information


def read_rows(records: pd.DataFrame, seed: int) -> list[ReadRow]:
    """Pool what each method reads of a setting at each view over all camera-display pairs.

    Args:
        records: predictions of one setting.
        seed: seed of the bootstrap of leads.
    """
    pooled = pool(score(records), ("view_deg", "method"))
    rows = []
    for row in pooled.itertuples():
        view = records[records["view_deg"] == row.view_deg]
        own = view[view["method"] == row.method]
        scores, bits = (np.concatenate(list(own[name])) for name in ("scores", "bits"))
        informed = decided_information(row.accuracy)
        if METHODS[row.method].llr:
            informed = information(scores, bits)
        rows.append(
            ReadRow(
                view_deg=float(row.view_deg),
                method=row.method,
                frames=int(row.frames),
                bits=int(row.bits),
                correct=int(row.correct),
                accuracy=float(row.accuracy),
                ci_low=row.low,
                ci_high=row.high,
                information=informed,
                lead=lead_of(view, row.method, seed),
            )
        )
    return rows


def lead_of(records: pd.DataFrame, method: str, seed: int) -> Lead | None:
    """Compare `learned` with another method on identical frame pairs; None for itself.

    Args:
        records: predictions of one setting at one view.
        method: label of the other method; frame pairs that it did not read are left out.
        seed: seed of the bootstrap.
    """
    if method == "learned":
        return None
    indices = records.loc[records["method"] == method, "index"].unique()
    both = records[records["index"].isin(indices)]
    paired = compare_methods(both, "learned", method, np.random.default_rng(seed))
    return None if paired is None else Lead(paired.difference, paired.low, paired.high)


def information(scores: np.ndarray, bits: np.ndarray) -> float:
    """Mutual information of a bit and its calibrated score, in bits: 1 minus the cross-entropy.

    Args:
        scores: natural log-likelihood ratios.
        bits: true bits, 0 or 1, of the same shape.

    >>> round(information(np.array([2.0, -2.0]), np.array([1, 0])), 3)
    0.817
    """
    against = np.where(bits > 0, -scores, scores)
    return 1 - float(np.logaddexp(0, against).mean() / np.log(2))
