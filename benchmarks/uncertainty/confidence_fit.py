"""Fits the three factors of the confidence (uncertainty/confidence_factors.h) to positions with known errors."""

import pathlib
import re

import numpy as np
from scipy.optimize import minimize

from benchmarks.uncertainty.stress import auroc

HEADER_PATH = (
    pathlib.Path(__file__).resolve().parents[2] / "src" / "colmap_lazyloc" / "uncertainty" / "confidence_factors.h"
)
MAX_KIND_WEIGHT = 60  # more queries of one kind do not count for more than this number
NUM_FOLDS = 8
# Bounds of uncertainty/confidence.cc.
MIN_EXPLAINED, MIN_NUM_POINTS, MIN_ODDS = 1e-3, 0.5, 1e-3
SINGLE_POINT_WEIGHT = 0.1


def evidence_of(outcomes, name, unknown):
    return np.array([unknown if (value := o.evidence[name]) is None else value for o in outcomes], float)


def odds_shapes(outcomes):
    """Returns the odds of another place, a competing pose and chance for factors of one, as confidence.cc does."""
    explained = evidence_of(outcomes, "explained_ratio", 1.0).clip(MIN_EXPLAINED, 1)
    error_px = evidence_of(outcomes, "median_error_px", np.nan)
    num_common, num_single = (evidence_of(outcomes, f"num_{kind}_tracks", 0.0) for kind in ("common", "single"))
    num_points = np.maximum(num_common + SINGLE_POINT_WEIGHT * num_single, MIN_NUM_POINTS)
    competing = evidence_of(outcomes, "competing_ratio", 0.0) ** 3
    return np.stack([(error_px * (1 - explained) / explained) ** 2, competing, num_points**-1.5], axis=1)


def fit(shapes, is_right, weights):
    """Returns the factors of the odds, by maximum likelihood."""

    def cost(log_factors):
        odds = shapes @ np.exp(log_factors) + MIN_ODDS
        return weights @ (np.log1p(odds) - np.where(is_right, 0, np.log(odds)))

    return np.exp(minimize(cost, np.zeros(3), method="Nelder-Mead").x)


def kind_weights(outcomes):
    kinds = np.array([o.kind for o in outcomes])
    counts = {kind: np.sum(kinds == kind) for kind in set(kinds)}
    return np.array([MAX_KIND_WEIGHT / max(MAX_KIND_WEIGHT, counts[kind]) for kind in kinds])


def cross_validate(outcomes, shapes, is_right, weights):
    """Returns the confidence in each outcome by factors that were fitted without its scene."""
    groups = sorted({o.group for o in outcomes})
    folds = dict(zip(groups, np.random.default_rng(0).permutation(len(groups)) % NUM_FOLDS, strict=True))
    fold_of = np.array([folds[o.group] for o in outcomes])
    confidences = np.zeros(len(outcomes))
    for fold in range(NUM_FOLDS):
        train = fold_of != fold
        if not train.all():
            factors = fit(shapes[train], is_right[train], weights[train])
            confidences[~train] = 1 / (1 + MIN_ODDS + shapes[~train] @ factors)
    return confidences


def write_header(values):
    """Replaces the constants in confidence_factors.h."""
    text = HEADER_PATH.read_text()
    for name, value in values.items():
        text = re.sub(rf"({name} = ).*?;", rf"\g<1>{value:.2g};", text)
    HEADER_PATH.write_text(text)


def fit_factors(outcomes):
    """Fits and writes the factors; prints them and the AUROC of cross-validation over scenes."""
    outcomes = [o for o in outcomes if o.has_pose]
    shapes, weights = odds_shapes(outcomes), kind_weights(outcomes)
    is_right = np.array([not o.is_wrong for o in outcomes])
    validated = cross_validate(outcomes, shapes, is_right, weights)
    place_odds, competing_odds, chance_odds = fit(shapes, is_right, weights)
    values = {"kPlaceOdds": place_odds, "kCompetingOdds": competing_odds, "kChanceNumPoints": chance_odds ** (1 / 1.5)}
    write_header(values)
    print(", ".join(f"{name} = {value:.2g}" for name, value in values.items()))
    print(f"{len(outcomes)} poses, {np.sum(~is_right)} wrong")
    print(f"AUROC, cross-validated over scenes: {auroc(validated, ~is_right):.3f}")
