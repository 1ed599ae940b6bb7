"""Fits the weights of the confidence (pipeline/confidence_weights.h) to positions with known errors."""

import dataclasses
import pathlib
import re

import numpy as np
from scipy.optimize import minimize

from benchmarks.uncertainty.stress import auroc

HEADER_PATH = (
    pathlib.Path(__file__).resolve().parents[2] / "src" / "colmap_lazyloc" / "pipeline" / "confidence_weights.h"
)
MAX_KIND_WEIGHT = 60  # more queries of one kind do not count for more than this number
RIDGE = 1.0  # of the weights of standardized terms
NUM_FOLDS = 8
RIVAL_POWER = 3  # kRivalPower of pipeline/confidence.cc


@dataclasses.dataclass
class Term:
    """A field of the evidence, the range that its value is clamped to, and the sign that its weight must have."""

    name: str
    is_logarithmic: bool
    low: float
    high: float
    sign: int
    unknown: float | None = None  # what an unknown value counts as; None: the median

    def transform(self, values):
        clamped = np.clip(values, self.low, self.high)
        return np.log(clamped) if self.is_logarithmic else clamped


TERMS = (
    Term("num_common_tracks", True, 1, 30, 1),
    Term("explained_ratio", False, 0, 0.6, 1),
    Term("agreeing_ratio", False, 0, 0.6, 1),
    Term("median_error_px", True, 0.1, 10, -1),
    Term("mean_error_px", True, 4, 30, -1),
    Term("mean_track_length", True, 2, 6, 1),
    Term("rotation_stddev_deg", True, 0.3, 1, -1),
    Term("rotation_position_ratio", True, 0.3, 2, 1),
    Term("start_distance_ratio", True, 0.01, 1, -1),
    Term("focal_stddev_ratio", True, 0.008, 0.03, -1, 0.008),
)


def rival_odds(outcomes):
    """Returns the odds that the rival is right instead, as pipeline/confidence.cc computes them."""
    ratios = np.array([o.evidence["rival_ratio"] or 0 for o in outcomes])
    return (np.minimum(ratios, 0.99) / (1 - np.minimum(ratios, 0.99))) ** RIVAL_POWER


def features(outcomes):
    """Returns a row of terms for each outcome; unknown evidence is typical, or that of the median."""
    columns = []
    for term in TERMS:
        values = np.array([np.nan if (v := o.evidence[term.name]) is None else v for o in outcomes], float)
        unknown = np.nanmedian(values) if term.unknown is None else term.unknown
        columns.append(term.transform(np.nan_to_num(values, nan=unknown)))
    return np.stack(columns, axis=1)


def fit(rows, rivals, is_right, weights):
    """Returns the intercept and the terms' weights, by maximum likelihood with a ridge and given signs.

    The odds of a wrong pose are the sum of those that the terms and those that the rivals give.
    """
    mean, scale = rows.mean(axis=0), rows.std(axis=0) + 1e-9
    design = np.column_stack([np.ones(len(rows)), (rows - mean) / scale])

    def cost(parameters):
        odds = np.exp(-np.clip(design @ parameters, -30, 30))
        loss = np.log(1 + odds + rivals) - np.where(is_right, 0, np.log(odds + rivals))
        slope = np.where(is_right, 0, odds / (odds + rivals)) - odds / (1 + odds + rivals)
        penalty = np.concatenate([[0], RIDGE * parameters[1:]])
        return weights @ loss + penalty @ parameters / 2, design.T @ (weights * slope) + penalty

    bounds = [(None, None)] + [(0, None) if term.sign > 0 else (None, 0) for term in TERMS]
    parameters = minimize(cost, np.zeros(design.shape[1]), jac=True, method="L-BFGS-B", bounds=bounds).x
    slopes = parameters[1:] / scale
    return parameters[0] - slopes @ mean, slopes


def kind_weights(outcomes):
    kinds = np.array([o.kind for o in outcomes])
    counts = {kind: np.sum(kinds == kind) for kind in set(kinds)}
    return np.array([MAX_KIND_WEIGHT / max(MAX_KIND_WEIGHT, counts[kind]) for kind in kinds])


def cross_validate(outcomes, rows, rivals, is_right, weights):
    """Returns the confidence in each outcome by a model that was fitted without its scene."""
    groups = sorted({o.group for o in outcomes})
    folds = dict(zip(groups, np.random.default_rng(0).permutation(len(groups)) % NUM_FOLDS, strict=True))
    fold_of = np.array([folds[o.group] for o in outcomes])
    confidences = np.zeros(len(outcomes))
    for fold in range(NUM_FOLDS):
        train = fold_of != fold
        if train.all():
            continue
        intercept, slopes = fit(rows[train], rivals[train], is_right[train], weights[train])
        confidences[~train] = 1 / (1 + np.exp(-intercept - rows[~train] @ slopes) + rivals[~train])
    return confidences


def number(value):
    return f"{value:.4g}"


def write_header(intercept, slopes, typical):
    """Replaces the table in confidence_weights.h."""
    log_odds = intercept + sum(
        slope * term.transform(value) for term, slope, value in zip(TERMS, slopes, typical, strict=True)
    )
    lines = [f"inline constexpr double kTypicalLogOdds = {number(log_odds)};"]
    lines.append(f"inline constexpr std::array<ConfidenceTerm, {len(TERMS)}> kConfidenceTerms = {{{{")
    for term, slope, value in zip(TERMS, slopes, typical, strict=True):
        numbers = ", ".join(map(number, (term.low, term.high, value, slope)))
        lines.append(f"    {{&PoseEvidence::{term.name}, {str(term.is_logarithmic).lower()}, {numbers}}},")
    lines.append("}};")
    text = HEADER_PATH.read_text()
    pattern = r"inline constexpr double kTypicalLogOdds.*?\n}};"
    HEADER_PATH.write_text(re.sub(pattern, lambda _: "\n".join(lines), text, flags=re.DOTALL))


def fit_weights(outcomes):
    """Fits and writes the weights; prints them and the AUROC of cross-validation over scenes."""
    outcomes = [o for o in outcomes if o.has_pose]
    rows, rivals, weights = features(outcomes), rival_odds(outcomes), kind_weights(outcomes)
    is_right = np.array([not o.is_wrong for o in outcomes])
    validated = cross_validate(outcomes, rows, rivals, is_right, weights)
    intercept, slopes = fit(rows, rivals, is_right, weights)
    medians = np.median(rows[is_right], axis=0)
    typical = [float(np.exp(m)) if term.is_logarithmic else float(m) for term, m in zip(TERMS, medians, strict=True)]
    write_header(intercept, slopes, typical)
    print("| term | weight | typical | times the standard deviation |\n|---|---|---|---|")
    for term, slope, value, deviation in zip(TERMS, slopes, typical, rows.std(axis=0), strict=True):
        print(f"| {term.name} | {slope:.3g} | {value:.3g} | {slope * deviation:.2f} |")
    print(f"\n{len(outcomes)} poses, {np.sum(~is_right)} wrong")
    print(f"AUROC, cross-validated over scenes: {auroc(validated, ~is_right):.3f}")
