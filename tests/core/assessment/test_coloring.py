"""The color of residuals and the scatter of maneuvers: definitions, limits, and coverage of the errors corrected by them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.fft import irfft
from scipy.signal import lfilter

from stoop.assessment.clusters import Influence, cluster_influence, cluster_scatter, moderated_scatter
from stoop.assessment.coloring import ColoredNoise, Coloring, between_lags, fit_noise
from stoop.assessment.covariance import NORMAL_95, data_information, standard_errors
from stoop.assessment.error_bars import Uncertainty, estimate_uncertainty
from stoop.estimate.noise import lagged_products
from stoop.problem.evidence import PieceEvidence, invert


def test_lagged_products_are_the_naive_sums() -> None:
    random = np.random.default_rng(0)
    pieces = [random.normal(size=(30, 2)), random.normal(size=(7, 2))]
    masks = [random.uniform(size=piece.shape) > 0.3 for piece in pieces]
    pieces = [np.where(mask, piece, 0.0) for piece, mask in zip(pieces, masks, strict=True)]
    sums, counts = lagged_products(pieces, [mask.astype(float) for mask in masks], 5)
    for lag in range(6):
        naive = sum((piece[: len(piece) - lag] * piece[lag:]).sum(axis=0) for piece in pieces)
        pairs = sum((mask[: len(mask) - lag] & mask[lag:]).sum(axis=0) for mask in masks)
        assert_allclose(sums[:, lag], naive, atol=1e-12)
        assert_allclose(counts[:, lag], pairs)


def test_lags_without_pairs_lie_between_those_with() -> None:
    whole = [1.0, 0.5, 0.2, 0.1, 0.0, 0.0, 0.0, 0.0]
    known = np.array([[4.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.0], whole, [0.0] * 8])
    found = between_lags(known, np.array([[9, 0, 0, 8, 0, 0, 7, 0], [9, 8, 7, 6, 5, 4, 3, 2], [0] * 8]))
    assert_allclose(found[0], [4.0, 3.0, 2.0, 1.0, 4.0 / 3.0, 5.0 / 3.0, 2.0, 4.0 / 3.0])
    assert_allclose(found[1:], known[1:])


def test_noise_has_a_memory_of_some_records() -> None:
    """Lags of a channel that hardly decay; the variance stays, and so does noise that decays within a record."""
    lags = np.arange(9)
    noise = fit_noise(np.array([4.0 * (1.0 - 1e-6 * lags), 2.0 * 0.9**lags]), 800.0)
    slow, fast = (np.abs(np.roots([1.0, *-channel])).max() for channel in noise.coefficients)
    assert (slow, fast) == (pytest.approx(1.0 - 1.0 / 800.0), pytest.approx(0.9, abs=1e-3))
    power = np.abs(noise.gain(2**18)) ** 2 * np.diag(noise.innovation)
    assert_allclose((2.0 * power.sum(axis=0) - power[0] - power[-1]) / 2**18, [4.0, 2.0], rtol=5e-3)


def test_impossible_autocovariance_stays_stable() -> None:
    noise = fit_noise(np.array([[1.0, 1.4, 0.2], [0.0, 0.0, 0.0]]), 40.0)
    assert np.abs(np.roots(np.concatenate([[1.0], -noise.coefficients[0]]))).max() < 1.0
    assert np.isfinite(noise.gain(64)).all()
    assert_allclose(noise.coefficients[1], 0.0)


def test_spectrum_transforms_to_the_autocovariance() -> None:
    noise = ColoredNoise(np.array([[0.8], [-0.3]]), np.array([[1.0, 0.4], [0.4, 2.0]]))
    gain, lags = noise.gain(512), np.arange(5)
    back = irfft(gain[:, :, None] * noise.innovation * gain.conj()[:, None, :], 512, axis=0)
    assert_allclose(back[:5, 0, 0], 0.8**lags / (1 - 0.64), atol=1e-9)
    # E[v0(i + l) v1(i)] = 0.8^l * 0.4 / (1 + 0.24)
    assert_allclose(back[:5, 0, 1], 0.8**lags * 0.4 / 1.24, atol=1e-9)
    assert back[1, 1, 0] == pytest.approx(-0.3 * 0.4 / 1.24)


CHANNELS, PARAMETERS = 2, 4


def sensitivities(size: int, seed: int = 0) -> np.ndarray:
    """Return (n, ny, k): answers of oscillators to a 3-2-1-1, a bias and an initial value per channel."""
    random, edges = np.random.default_rng(seed), (np.array([1, 4, 6, 7, 8]) * size) // 12
    command = np.zeros(size)
    for start, stop, sign in zip(edges[:-1], edges[1:], (1, -1, 1, -1), strict=True):
        command[start:stop] = sign
    columns = np.zeros((size, CHANNELS, PARAMETERS + 2 * CHANNELS))
    for channel in range(CHANNELS):
        for parameter in range(PARAMETERS):
            pole = np.exp((-random.uniform(0.5, 3) + 1j * random.uniform(1, 8)) / 100)
            answer = lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], command)
            columns[:, channel, parameter] = answer / np.sqrt(np.mean(answer**2))
        columns[:, channel, PARAMETERS + channel] = 1.0
        columns[:, channel, PARAMETERS + CHANNELS + channel] = np.exp(-np.arange(size) / 80.0)
    return columns


def noise(size: int, rho: float, random: np.random.Generator) -> np.ndarray:
    white = random.normal(size=(size + 400, CHANNELS))
    return np.asarray(lfilter([np.sqrt(1 - rho**2)], [1.0, -rho], white, axis=0)[400:])


def test_the_double_sum_done_naively() -> None:
    first, second = sensitivities(60), sensitivities(40, seed=1)
    segments = (PieceEvidence(np.zeros((60, 2)), first), PieceEvidence(np.zeros((40, 2)), second))
    prior = np.diag([0.3**-2.0] + [0.0] * 7)
    inverse = invert(data_information(segments) + prior)
    color = ColoredNoise(np.array([[0.6], [-0.4]]), np.array([[1.0, 0.5], [0.5, 2.0]]))
    stationary, middle = color.innovation / (1 - np.outer([0.6, -0.4], [0.6, -0.4])), np.zeros_like(prior)
    for jacobian in (first, second):
        for i, left in enumerate(jacobian):
            for j, right in enumerate(jacobian):
                power = np.diag(np.array([0.6, -0.4]) ** abs(i - j))
                middle += left.T @ (power @ stationary if i >= j else stationary @ power) @ right
    naive = inverse.matrix @ (middle + prior) @ inverse.matrix
    found = Coloring(segments, inverse, prior).covariance(color)
    assert_allclose(found, naive, rtol=1e-6, atol=1e-9 * np.abs(naive).max())


def judged(jacobian: np.ndarray, measured: np.ndarray, *edges: int) -> tuple[np.ndarray, Uncertainty]:
    """Return the estimate of ordinary least squares and its uncertainty, of pieces between edges; NaN is missing."""
    there = np.isfinite(measured)
    estimate = np.linalg.lstsq(jacobian[there], measured[there], rcond=None)[0]
    parts = (np.split(x, edges) for x in (measured - jacobian @ estimate, jacobian))
    pieces = [PieceEvidence(*part) for part in zip(*parts, strict=True)]
    return estimate, estimate_uncertainty(pieces, np.zeros((jacobian.shape[2],) * 2))


def test_bands_frequency_by_frequency() -> None:
    coherency = np.stack([np.eye(CHANNELS, dtype=np.complex128)] * 2)
    coherency[0, 0, 1], coherency[0, 1, 0] = 0.3 + 0.4j, 0.3 - 0.4j
    coefficients = np.array([[0.6, 0.1], [-0.4, 0.2]])
    noise = ColoredNoise(coefficients, np.diag([1.0, 2.0]), np.array([0.0, 0.2, 0.5]), coherency)
    found = Coloring.of([PieceEvidence(np.zeros((60, CHANNELS)), sensitivities(60))], np.eye(8))
    block, spread = found.blocks[0], np.diag(np.arange(1.0, 9.0))
    gain, S = noise.gain(block.size), block.parts[0] + 1j * block.parts[1]
    middle, absorbed = np.zeros((8, 8)), np.zeros((2, CHANNELS, CHANNELS), complex)
    inner = block.basis @ spread @ block.basis.T
    for f in range(block.size // 2 + 1):
        band, G, s = int(f / block.size >= 0.2), np.diag(gain[f]), S[:, f]
        power = G @ noise.powers[band] @ G.conj().T
        middle += (s.conj().T @ power @ s).real
        crossed = s @ s.conj().T @ power
        excess = crossed + crossed.conj().T - s @ inner @ s.conj().T
        absorbed[band] += np.linalg.inv(G) @ excess @ np.linalg.inv(G).conj().T
    whitened = block.whitened(noise)
    assert_allclose(whitened.middle(noise.roots), middle, rtol=1e-10, atol=1e-12)
    assert_allclose(whitened.absorbed(noise.powers, spread), absorbed, rtol=1e-10, atol=1e-12)


def covered(rho: float) -> tuple[float, float, float]:
    """Return the coverage of 95 % intervals, that of plain ones, and the mean widening, in 250 fits to colored noise."""
    random, jacobian, each = np.random.default_rng(11), sensitivities(800), []
    for _ in range(250):
        estimate, found = judged(jacobian, noise(800, rho, random))
        wide, narrow = (standard_errors(c)[:PARAMETERS] for c in (found.corrected, found.cramer_rao))
        error = np.abs(estimate[:PARAMETERS])
        each.append((error < NORMAL_95 * wide, error < NORMAL_95 * narrow, wide / narrow))
    hits, plain, factor = np.mean(each, axis=(0, 2)).tolist()
    return hits, plain, factor


def test_coverage_of_95_percent_intervals_in_white_noise() -> None:
    hits, plain, factor = covered(0.0)
    assert 0.92 < plain < 0.97
    assert 0.92 < hits < 0.98
    assert factor == pytest.approx(1.0, abs=0.02)


def test_coverage_of_95_percent_intervals_in_colored_noise() -> None:
    hits, plain, _ = covered(0.95)
    assert 0.1 < plain < 0.4
    assert 0.90 < hits < 0.98


@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_mean_of_the_corrected_error_is_the_scatter(missing: float) -> None:
    random, jacobian, estimates, sigmas = np.random.default_rng(5), sensitivities(900), [], []
    for _ in range(200):
        measured = noise(900, 0.9, random)
        measured[random.uniform(size=measured.shape) < missing] = np.nan
        one, found = judged(jacobian, measured, 400)
        estimates.append(one)
        sigmas.append(standard_errors(found.corrected))
    assert_allclose((np.mean(sigmas, axis=0) / np.std(estimates, axis=0))[:PARAMETERS], 1.0, atol=0.15)


@pytest.mark.parametrize(("apart", "rho"), [(2.7, 0.98), (4.6, 0.98), (5.4, 0.9), (13.3, 0.98)])
def test_a_channel_that_is_read_now_and_then(apart: float, rho: float) -> None:
    """Few of its readings, or none, are one sample apart, and its color is no zero there."""
    random, jacobian, estimates, sigmas = np.random.default_rng(5), sensitivities(300), [], []
    hole = np.setdiff1d(np.arange(300), np.rint(np.arange(0.0, 299.0, apart)))
    jacobian[hole, 1] = 0.0
    for _ in range(40):
        measured = noise(300, rho, random)
        measured[hole, 1] = np.nan
        one, found = judged(jacobian, measured)
        estimates.append(one[:PARAMETERS])
        sigmas.append(standard_errors(found.corrected)[:PARAMETERS])
    ratios = sigmas / np.std(estimates, axis=0)
    assert 0.6 < ratios.mean() < 1.3
    assert ratios.max() < 2.5


def test_unseen_unknowns_are_infinite_and_disturb_no_other() -> None:
    jacobian, measured = sensitivities(500), noise(500, 0.5, np.random.default_rng(4))
    _, whole = judged(jacobian, measured)
    _, found = judged(np.concatenate([jacobian, np.zeros((500, CHANNELS, 1))], axis=2), measured)
    assert_allclose(found.corrected[:8, :8], whole.corrected, rtol=1e-9)
    assert standard_errors(found.corrected)[8] == standard_errors(found.cramer_rao)[8] == np.inf


SAMPLES, SHARED, OWN = 60, 12, 2
WHITE = ColoredNoise.white(1)


def seen_by(clusters: int, seed: int) -> list[np.ndarray]:
    """Return (n, 1, k) of each maneuver: parameters that all share, then unknowns that it alone sees."""
    random, out = np.random.default_rng(seed), []
    for g in range(clusters):
        jacobian = np.zeros((SAMPLES, 1, SHARED + clusters * OWN))
        jacobian[:, 0, :SHARED] = random.normal(size=(SAMPLES, SHARED))
        own = SHARED + g * OWN
        jacobian[:, 0, own : own + OWN] = random.normal(size=(SAMPLES, OWN))
        out.append(jacobian)
    return out


def linear_fit(
    jacobians: list[np.ndarray], noise: list[np.ndarray], prior: np.ndarray
) -> tuple[Coloring, np.ndarray]:
    pieces = [PieceEvidence(v[:, None], J) for v, J in zip(noise, jacobians, strict=True)]
    information = data_information(pieces) + prior
    score = sum(J[:, 0].T @ v for v, J in zip(noise, jacobians, strict=True))
    estimates = np.linalg.solve(information, score)
    fitted = tuple(PieceEvidence(p.residual - p.jacobian @ estimates, p.jacobian) for p in pieces)
    return Coloring(fitted, invert(information), prior), estimates


def test_expectation_and_degrees_of_freedom_by_simulation() -> None:
    """Under the noise that is assumed the ratios average 1, and scatter as chi-squares with their degrees of freedom."""
    jacobians, random = seen_by(3, seed=1), np.random.default_rng(2)
    prior, ratios = np.diag([4.0] * 3 + [0.0] * (SHARED - 3) + [25.0] * (3 * OWN)), []
    for _ in range(1500):
        fit, _ = linear_fit(jacobians, [random.normal(size=SAMPLES) for _ in jacobians], prior)
        mean = random.normal(size=len(prior)) * np.sqrt(np.diag(prior))  # of the priors, as noise of theirs
        moved = -fit.inverse.matrix @ mean
        shifted = tuple(PieceEvidence(s.residual + s.jacobian @ moved, s.jacobian) for s in fit.segments)
        moves = cluster_influence(Coloring(shifted, fit.inverse, prior), WHITE, [0, 1, 2], SHARED)
        ratios.append(moves.ratio)
    found = np.array(ratios)
    assert_allclose(found.mean(axis=0), 1.0, atol=0.12)
    assert_allclose(found.var(axis=0), 2.0 / moves.degrees, rtol=0.3)


def test_nothing_to_compare() -> None:
    fit, _ = linear_fit(seen_by(1, 0), [np.ones(SAMPLES)], np.zeros((SHARED + OWN,) * 2))
    assert cluster_scatter(fit, WHITE, ["one"], SHARED) is None
    apart = seen_by(2, 0)
    apart[0][:, :, : SHARED // 2] = 0.0  # no parameter in common
    apart[1][:, :, SHARED // 2 : SHARED] = 0.0
    drawn = [np.random.default_rng(i).normal(size=SAMPLES) for i in range(2)]
    fit, _ = linear_fit(apart, drawn, np.zeros((SHARED + 2 * OWN,) * 2))
    assert cluster_scatter(fit, WHITE, [0, 1], SHARED) is None


def test_common_excess_and_chance() -> None:
    ones, chance = np.ones(40), np.random.default_rng(0).chisquare(3, 40) / 3
    calm, excess, known = (
        moderated_scatter(Influence(ratio, 3.0 * ones, prior * ones), 4)
        for ratio, prior in ((0.9 * ones, 0.0), (9.0 * chance, 0.0), (9.0 * ones, 1.0))
    )
    assert np.all((calm.stretch >= 1.0) & (calm.stretch < 1.15))
    assert excess.excess == pytest.approx(3.0, rel=0.15)
    assert np.median(excess.stretch) == pytest.approx(3.0, rel=0.25)
    assert_allclose(known.stretch, 1.0)  # what the prior says, maneuvers do not change


@pytest.mark.parametrize(("excess", "low", "high"), [(0.0, 0.93, 0.995), (0.4, 0.90, 0.98)])
@pytest.mark.parametrize("clusters", [2, 5])
def test_intervals_of_effects_that_differ(clusters: int, excess: float, low: float, high: float) -> None:
    normal, holds, plain = np.random.default_rng(3).normal, [], []
    prior = np.diag([0.0] * SHARED + [25.0] * (clusters * OWN))
    for seed in range(150):
        jacobians = seen_by(clusters, seed)
        noise = [normal(size=SAMPLES) + J[:, 0, :SHARED] @ (excess * normal(size=SHARED)) for J in jacobians]
        fit, estimates = linear_fit(jacobians, noise, prior)
        off = np.abs(estimates / np.sqrt(np.diag(fit.inverse.matrix)))[:SHARED]
        scatter = cluster_scatter(fit, WHITE, list(range(clusters)), SHARED)
        assert scatter is not None
        holds.append(off <= NORMAL_95 * scatter.stretch)
        plain.append(off <= NORMAL_95)
    assert low <= np.mean(holds) <= high
    assert np.mean(plain) < 0.8 or excess == 0.0
