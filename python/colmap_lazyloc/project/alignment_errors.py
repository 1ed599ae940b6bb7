"""How accurate the orientation and the scale of a model are that was aligned to positions, such as GPS.

The errors of GPS positions are similar in consecutive photos, so the mean of many positions is not much more accurate
than one of them. How long they stay similar follows from the residuals of the alignment only in part, because the
alignment takes slow errors for a rotation or for a scale.
"""

import dataclasses

import numpy as np

from colmap_lazyloc.array_types import Floats

# Errors of positions: the sum of independent ones, with this share of the variance, and of a Gauss-Markov process,
# whose correlation falls to 1/e over this multiple of the series of photos. The first are all independent.
INDEPENDENT = (1.0, 0.0)
CORRELATED = [(share, length) for length in (1 / 16, 1 / 4, 1.0, 4.0) for share in (0.0, 0.1, 0.4)]
MAX_NUM_PHOTOS = 1000  # because the time grows with the third power
HEADING, SCALE, NUM_PARAMETERS = 2, 3, 7  # of a similarity: three rotations, the scale, three of a translation


@dataclasses.dataclass(frozen=True)
class AlignmentErrors:
    """Standard deviations of an alignment."""

    tilt_deg: float  # about the less certain horizontal axis
    heading_deg: float
    rotation_deg: float  # about the least certain axis
    scale_percent: float

    def with_tilt(self, tilt_deg: float) -> "AlignmentErrors":
        """Returns the deviations with that of a tilt which does not follow from positions."""
        return dataclasses.replace(self, tilt_deg=tilt_deg, rotation_deg=max(tilt_deg, self.heading_deg))

    def max(self, other: "AlignmentErrors") -> "AlignmentErrors":
        """Returns the larger ones of two."""
        pairs = zip(dataclasses.astuple(self), dataclasses.astuple(other))
        return AlignmentErrors(*(max(pair) for pair in pairs))


def estimate_errors(
    centres: Floats, targets: Floats, stddev: float, is_series: bool, is_level: bool = False
) -> AlignmentErrors:
    """Returns the deviations of the similarity that has moved `centres` to `targets`, both n x 3.

    They are the larger ones of two: by the residuals, in which each structure of the errors counts as much as the
    residuals make it probable, and by the accuracy that is stated for positions.

    `stddev`: the stated one, along an axis; `is_series`: the errors of one position may be similar to those of the next
    ones; `is_level`: the similarity has kept the direction of z.
    """
    step = -(-len(centres) // MAX_NUM_PHOTOS)
    jacobian = _jacobian(centres[::step], is_level)
    residuals = (targets - centres)[::step]
    if np.linalg.matrix_rank(jacobian.reshape(-1, jacobian.shape[2])) < jacobian.shape[2]:
        return AlignmentErrors(np.inf, np.inf, np.inf, np.inf)
    structures = [INDEPENDENT, *(CORRELATED if is_series else ())]
    by_residuals, by_accuracy, logs = [], [], []
    for structure in structures:
        correlation = _correlation(len(residuals), *structure)
        variances, log_likelihood = _fit_variances(jacobian, residuals, correlation)
        by_residuals.append(_propagate(jacobian, correlation, variances))
        by_accuracy.append(_propagate(jacobian, correlation, np.full(3, stddev**2)))
        logs.append(log_likelihood)
    priors = np.array([1.0, *[1 / len(CORRELATED)] * (len(structures) - 1)])  # that they are independent: one half
    probabilities = priors * np.exp(np.array(logs) - max(logs))
    return _deviations(by_residuals, probabilities, is_level).max(_deviations(by_accuracy, priors, is_level))


def _jacobian(centres: Floats, is_level: bool) -> Floats:
    """Returns the derivatives of centres by a similarity, n x 3 x 7, or n x 3 x 5 without those by a tilt."""
    offsets = centres - centres.mean(axis=0)
    jacobian = np.zeros((len(offsets), 3, NUM_PARAMETERS))
    jacobian[:, :, :SCALE] = np.cross(np.eye(3), offsets[:, None]).transpose(0, 2, 1)
    jacobian[:, :, SCALE] = offsets
    jacobian[:, :, SCALE + 1 :] = np.eye(3)
    return jacobian[:, :, HEADING:] if is_level else jacobian


def _correlation(count: int, share: float, length: float) -> Floats:
    """Returns the correlations between the errors of photos."""
    identity = np.eye(count)
    if share == 1:
        return identity
    numbers = np.arange(count)
    return share * identity + (1 - share) * np.exp(-np.abs(numbers[:, None] - numbers) / (length * count))


def _fit_variances(jacobian: Floats, residuals: Floats, correlation: Floats) -> tuple[Floats, float]:
    """Returns the variances of errors along the axes, and the logarithm of the likelihood of the residuals that are
    left by a similarity (restricted maximum likelihood)."""
    count, _, num_parameters = jacobian.shape
    whitening = np.linalg.inv(np.linalg.cholesky(correlation))
    basis, triangle = np.linalg.qr((whitening @ jacobian.reshape(count, -1)).reshape(-1, num_parameters))
    errors = (whitening @ residuals).ravel()
    errors -= basis @ (basis.T @ errors)
    num_free = 3 * count - num_parameters
    square = max(float(errors @ errors), np.finfo(float).tiny)
    log_likelihood = 3 * np.log(np.diag(whitening)).sum() - np.log(np.abs(np.diag(triangle))).sum()
    log_likelihood -= num_free / 2 * np.log(square)
    # The mean of all axes counts as one more error of each, because few photos say little about an axis.
    num_free_of_axes = count - (basis.reshape(count, 3, num_parameters) ** 2).sum(axis=(0, 2))
    squares = (errors.reshape(count, 3) ** 2).sum(axis=0)
    return (squares + square / max(num_free - 2, 1)) / (num_free_of_axes + 1), float(log_likelihood)


def _propagate(jacobian: Floats, correlation: Floats, variances: Floats) -> Floats:
    """Returns the covariance of a similarity by least squares, without weights, from that of positions."""
    count, _, num_parameters = jacobian.shape
    inverse = np.linalg.pinv(jacobian.reshape(-1, num_parameters)).reshape(num_parameters, count, 3)
    total = np.zeros((num_parameters, num_parameters))
    for axis, variance in enumerate(variances):
        total += variance * inverse[:, :, axis] @ correlation @ inverse[:, :, axis].T
    return total


def _deviations(covariances: list[Floats], weights: Floats, is_level: bool) -> AlignmentErrors:
    """Returns the deviations by the mean of covariances."""
    covariance = np.average(covariances, axis=0, weights=weights)
    scale_percent = 100 * float(np.sqrt(covariance[-4, -4]))
    if is_level:
        heading_deg = float(np.degrees(np.sqrt(covariance[0, 0])))
        return AlignmentErrors(0.0, heading_deg, heading_deg, scale_percent)
    tilt, rotation = (np.degrees(np.sqrt(np.linalg.eigvalsh(covariance[:n, :n])[-1])) for n in (HEADING, SCALE))
    heading_deg = float(np.degrees(np.sqrt(covariance[HEADING, HEADING])))
    return AlignmentErrors(float(tilt), heading_deg, float(rotation), scale_percent)
