"""Fits the two factors of the confidence (uncertainty/confidence_factors.h) to positions with known errors."""

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
MIN_SUPPORT, MIN_NUM_POINTS, MIN_ODDS = 1e-3, 0.5, 1e-3
SINGLE_POINT_WEIGHT = 0.1


def evidence_of(outcomes, name, unknown):
    return np.array([unknown if (value := o.evidence[name]) is None else value for o in outcomes], float)


def odds_of_competing_pose(outcomes):
    competing, agreeing = (evidence_of(outcomes, name, 0.0) for name in ("competing_ratio", "agreeing_ratio"))
    return (competing / np.maximum(agreeing, MIN_SUPPORT)) ** 3


def odds_shapes(outcomes):
    """Returns the odds of another place and of chance for factors of one, as uncertainty/confidence.cc does."""
    explained, agreeing = (evidence_of(outcomes, f"{kind}_ratio", 1.0) for kind in ("explained", "agreeing"))
    support = ((explained + agreeing) / 2).clip(MIN_SUPPORT, 1)
    error_px = evidence_of(outcomes, "median_error_px", np.nan)
    num_common, num_single = (evidence_of(outcomes, f"num_{kind}_tracks", 0.0) for kind in ("common", "single"))
    num_points = np.maximum(num_common + SINGLE_POINT_WEIGHT * num_single, MIN_NUM_POINTS)
    return np.stack([(error_px * (1 - support) / support) ** 2, num_points**-1.5], axis=1)


def fit(shapes, other_odds, is_right, weights):
    """Returns the factors of the two odds, by maximum likelihood. other_odds: those that have no factor."""

    def cost(log_factors):
        odds = shapes @ np.exp(log_factors) + other_odds
        return weights @ (np.log1p(odds) - np.where(is_right, 0, np.log(odds)))

    return np.exp(minimize(cost, np.zeros(2), method="Nelder-Mead").x)


def kind_weights(outcomes):
    kinds = np.array([o.kind for o in outcomes])
    counts = {kind: np.sum(kinds == kind) for kind in set(kinds)}
    return np.array([MAX_KIND_WEIGHT / max(MAX_KIND_WEIGHT, counts[kind]) for kind in kinds])


def cross_validate(outcomes, shapes, other_odds, is_right, weights):
    """Returns the confidence in each outcome by factors that were fitted without its scene."""
    groups = sorted({o.group for o in outcomes})
    folds = dict(zip(groups, np.random.default_rng(0).permutation(len(groups)) % NUM_FOLDS, strict=True))
    fold_of = np.array([folds[o.group] for o in outcomes])
    confidences = np.zeros(len(outcomes))
    for fold in range(NUM_FOLDS):
        train = fold_of != fold
        if not train.all():
            factors = fit(shapes[train], other_odds[train], is_right[train], weights[train])
            confidences[~train] = 1 / (1 + other_odds[~train] + shapes[~train] @ factors)
    return confidences


def write_header(place_odds, chance_num_points):
    """Replaces the constants in confidence_factors.h."""
    text = HEADER_PATH.read_text()
    for name, value in (("kPlaceOdds", place_odds), ("kChanceNumPoints", chance_num_points)):
        text = re.sub(rf"({name} = ).*?;", rf"\g<1>{value:.2g};", text)
    HEADER_PATH.write_text(text)


def fit_factors(outcomes):
    """Fits and writes the factors; prints them and the AUROC of cross-validation over scenes."""
    outcomes = [o for o in outcomes if o.has_pose]
    shapes, weights = odds_shapes(outcomes), kind_weights(outcomes)
    other_odds = odds_of_competing_pose(outcomes) + MIN_ODDS
    is_right = np.array([not o.is_wrong for o in outcomes])
    validated = cross_validate(outcomes, shapes, other_odds, is_right, weights)
    place_odds, chance_odds = fit(shapes, other_odds, is_right, weights)
    write_header(place_odds, chance_odds ** (1 / 1.5))
    print(f"odds of another place {place_odds:.2g}, points of chance {chance_odds ** (1 / 1.5):.2g}")
    print(f"{len(outcomes)} poses, {np.sum(~is_right)} wrong")
    print(f"AUROC, cross-validated over scenes: {auroc(validated, ~is_right):.3f}")
