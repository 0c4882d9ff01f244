"""The drag polar CD = CD0 + K (CL - CL0)^2 of a performance flight, with intervals that respect color.

The flight is cut into blocks of some seconds. With the airspeed V, the height h and a steady wind,

    (T - D) V = d/dt [m (V^2 / 2 + g h)]        the energy-rate method
    L = m (a_x sin(alpha) - a_z cos(alpha))     from the accelerometers, thrust along the flight path

No accelerometer bias enters drag, and what a gust adds within a block it takes away again. What remains is
vertical wind: a climb of the air of 0.1 m/s is as much as a power of m g 0.1 m/s.

Where only the electric power is known, the useful power follows from momentum theory (Rankine, Froude): an
actuator disc of diameter d that receives eta P gives

    eta P = 2 rho A (V + v)^2 v,  A = pi d^2 / 4,  T V = eta P V / (V + v)

with the induced speed v. eta (motor, controller, blades) and d are unknowns with priors; where power varies at
one lift coefficient the flight itself tells them, and their error is in every interval. So is that of the
airspeed, as an unknown factor.

References
----------
Kimberlin, "Flight Testing of Fixed-Wing Aircraft", AIAA, 2003, chapters on energy methods and drag polars.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from stoop import Flight
from stoop.extend.arrays import FloatArray, robust_std, run_slices
from stoop.extend.errors import FlightError
from stoop.extend.fits import NORMAL_95, PieceEvidence, estimate_uncertainty
from stoop.extend.units import STANDARD_GRAVITY, standard_density

HUBER: Final = 1.345  #: standard deviations; 95 % efficient on Gaussian noise
MIN_BLOCKS: Final = 12  #: below which no parabola is fitted
SWITCHED_OFF: Final = 0.02  #: of full throttle
NEEDED: Final = ("V", "alpha", "ax", "az", "altitude")
SHAPE: Final = ("c0", "c1", "c2")  #: CD = c0 + c1 CL + c2 CL^2
MAX_ITERATIONS: Final = 30
STEP: Final = 1e-6
DISC: Final = 0.35  #: of the root of the wing area: usual diameter of all propellers' discs together ...
DISC_SPREAD: Final = float(np.log(1.6))  #: ... within this factor


@dataclass(frozen=True, eq=False)
class Blocks:
    """Means over blocks; n = block."""

    time: FloatArray  #: (n,) s, middle
    stretch: NDArray[np.intp]  #: (n,) number of the contiguous stretch that each belongs to
    speed: FloatArray  #: (n,) m/s, true airspeed
    density: FloatArray  #: (n,) kg/m3
    lift: FloatArray  #: (n,) N
    kinetic: FloatArray  #: (n,) W, rate of m V^2 / 2
    potential: FloatArray  #: (n,) W, rate of m g h
    alpha: FloatArray  #: (n,) rad
    power: FloatArray  #: (n,) W, electric; zero with the motor off
    powered: bool  #: whether the power was measured; else all blocks are glides


def blocks(
    flight: Flight, mass: float, windows: Sequence[tuple[float, float]] = (), length: float = 5.0
) -> Blocks:
    """Cut the airborne part of a flight, or windows of it, into blocks.

    Parameters
    ----------
    flight : Flight
    mass : float, kg
    windows : sequence of (start, stop), s on the log's own clock
    length : float, s: longer than motor and pilot take, shorter than a climb

    Raises
    ------
    FlightError
        A channel is missing, the power is not known, or too few samples are left.
    """
    column = {name: flight.column(name) for name in NEEDED if name in flight.names}
    lacking = [name for name in NEEDED if name not in column or not np.isfinite(column[name]).any()]
    if lacking:
        raise FlightError(
            f"{flight.name}: a drag polar needs {', '.join(NEEDED)}; this flight lacks {', '.join(lacking)}"
        )
    # zero where the throttle is closed, and NaN where nothing is known
    throttles = [flight.column(name) for name in ("throttle", "control_throttle") if name in flight.names]
    throttle = next((x for x in throttles if np.nanmax(x, initial=0.0) > SWITCHED_OFF), None)
    powered = {"voltage", "current"} <= flight.names
    if powered:
        power = flight.column("voltage") * flight.column("current")
    elif throttle is not None:
        power = np.where(throttle <= SWITCHED_OFF, 0.0, np.nan)
    else:
        raise FlightError(
            f"{flight.name}: nothing shows the power: neither voltage and current of the battery, nor a throttle that "
            "shows where the motor is off; log one of them"
        )
    good = flight.airborne() & np.isfinite(np.column_stack([power, *column.values()])).all(axis=1)
    if windows:
        good &= np.logical_or.reduce([(flight.time >= a) & (flight.time <= b) for a, b in windows])
    size = max(1, round(length * flight.rate))
    starts = [
        (number, at)
        for number, run in enumerate(run_slices(good))
        for at in range(run.start, run.stop - size, size)
    ]
    if len(starts) < MIN_BLOCKS:
        raise FlightError(
            f"{flight.name}: only {len(starts)} blocks of {length:g} s fly with speed, height and "
            f"{'power' if powered else 'the motor off'} known, at least {MIN_BLOCKS} are needed; give longer windows"
        )
    stretch, first = np.array(starts).T
    V, alpha = column["V"], column["alpha"]
    lift = mass * (column["ax"] * np.sin(alpha) - column["az"] * np.cos(alpha))
    logged = flight.column("density") if "density" in flight.names else np.full(V.size, np.nan)
    if np.isfinite(logged).any():
        density = np.where(np.isfinite(logged), logged, np.nanmedian(logged))
    else:
        density = np.asarray(standard_density(column["altitude"]))

    def mean(x: FloatArray) -> FloatArray:
        return np.array([np.nanmean(x[at : at + size]) for at in first])

    def rate(x: FloatArray) -> FloatArray:
        return np.asarray((x[first + size] - x[first]) / (size / flight.rate))

    return Blocks(
        mean(flight.time), stretch, mean(V), mean(density), mean(lift), rate(0.5 * mass * V**2),
        rate(mass * STANDARD_GRAVITY * column["altitude"]), mean(alpha), mean(power), powered,
    )  # fmt: skip


@dataclass(frozen=True)
class Propulsion:
    """What is assumed of the propulsion."""

    #: electric power to power in the disc: motor, controller, blades, no induced loss
    efficiency: float = 0.70
    efficiency_std: float = 0.10
    #: m, of the disc; of several that of one with their whole area; None when unknown
    diameter: float | None = None


@dataclass(frozen=True, eq=False)
class Bin:
    """Medians over blocks of similar lift coefficient: CL, CD, half the spread that covers 68 % of CD, count."""

    CL: float
    CD: float
    spread: float
    count: int


@dataclass(frozen=True, eq=False)
class Polar:
    """A fitted polar of a wing of `area` [m2] and an airplane of `mass` [kg]; k = unknown, n = block."""

    blocks: Blocks
    area: float
    mass: float
    names: tuple[str, ...]
    #: (k,) c0, c1, c2 [1], airspeed factor [1] and, with power, efficiency [1] and logarithm of the diameter [m]
    values: FloatArray
    covariance: FloatArray  #: (k, k), corrected for the color of the residuals, priors in it
    prior_std: FloatArray  #: (k,), NaN where there is none
    CL: FloatArray  #: (n,), at the estimates of airspeed and propulsion
    CD: FloatArray  #: (n,)
    weights: FloatArray  #: (n,) of the robust fit, 0 to 1

    @property
    def std(self) -> FloatArray:
        """Standard errors (k,)."""
        return np.sqrt(np.diag(self.covariance))

    def drag(self, CL: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return CD and its standard error at lift coefficients (n,)."""
        rows = np.zeros((len(CL), len(self.values)))
        rows[:, :3] = np.column_stack([np.ones_like(CL), CL, CL**2])
        return rows @ self.values, np.sqrt(np.einsum("ni,ij,nj->n", rows, self.covariance, rows))

    @cached_property
    def summary(self) -> Mapping[str, tuple[float, float]]:
        """Return CD0, K, CL0, best glide and the propulsion: (value, standard error); NaN where K is not positive."""

        def derived(values: FloatArray) -> FloatArray:
            c0, c1, c2 = (float(v) for v in values[:3])
            parabola = (c0 - c1**2 / (4.0 * c2), c2, -c1 / (2.0 * c2)) if c2 > 0.0 else (np.nan,) * 3
            least = c1 + 2.0 * np.sqrt(c0 * c2) if c0 > 0.0 and c2 > 0.0 else -1.0
            return np.array(
                [*parabola, 1.0 / least if least > 0.0 else np.nan]
            )  # CL / CD at CL = sqrt(c0 / c2)

        found, slopes = self._slopes(derived)
        names = ("CD0", "K", "CL0", "best glide")
        stds = (float(np.sqrt(slope @ self.covariance @ slope)) for slope in slopes.T)
        out = dict(zip(names, zip(found.tolist(), stds, strict=True), strict=True))
        for name, v, s in zip(self.names, self.values.tolist(), self.std.tolist(), strict=True):
            if name not in SHAPE:
                out[name] = (float(np.exp(v)), float(np.exp(v) * s)) if name == "diameter" else (v, s)
        return out

    def level_power(self, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the electric power of steady level flight and its standard error, W, at airspeeds (n,) m/s.

        NaN where none balances the drag: it is far below zero.
        """
        rho = float(np.median(self.blocks.density))

        def power(values: FloatArray) -> FloatArray:
            """Return the power at which useful power and drag balance."""
            named = dict(zip(self.names, values, strict=True))
            pressure_area = 0.5 * rho * speed**2 * self.area
            CL = float(np.median(self.blocks.lift)) / pressure_area
            drag = pressure_area * (named["c0"] + named["c1"] * CL + named["c2"] * CL**2)
            disc = 0.25 * np.pi * np.exp(2.0 * named["diameter"])
            with np.errstate(invalid="ignore"):
                induced = 0.5 * (np.sqrt(speed**2 + 2.0 * drag / (rho * disc)) - speed)
            return np.asarray(drag * (speed + induced) / named["efficiency"])

        value, slopes = self._slopes(power)
        return value, np.sqrt(np.einsum("in,ij,jn->n", slopes, self.covariance, slopes))

    def bins(self) -> list[Bin]:
        """Return medians in eight bins, of four blocks and more each."""
        out = []
        for part in np.array_split(np.argsort(self.CL, kind="stable"), min(8, max(1, len(self.CL) // 4))):
            middle = float(np.median(self.CD[part]))
            spread = robust_std(self.CD[part] - middle)
            out.append(Bin(float(np.median(self.CL[part])), middle, spread, len(part)))
        return out

    @cached_property
    def valid(self) -> tuple[float, float]:
        """Return the lift coefficients between which 90 % of the blocks lie."""
        low, high = np.quantile(self.CL, [0.05, 0.95])
        return float(low), float(high)

    def interval(self, CL: float) -> tuple[float, float]:
        """Return the 95 % interval of CD at one lift coefficient."""
        value, std = self.drag(np.array([CL]))
        return float(value[0] - NORMAL_95 * std[0]), float(value[0] + NORMAL_95 * std[0])

    def _slopes(self, function: Callable[[FloatArray], FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return a function (n,) of the values, and its derivatives (k, n) by forward differences."""
        value = function(self.values)
        steps = STEP * np.eye(len(self.values))
        return value, np.array([(function(self.values + step) - value) / STEP for step in steps])


def useful_power(
    power: FloatArray, speed: FloatArray, density: FloatArray, efficiency: float, area: float
) -> FloatArray:
    """Return the thrust power T V (n,) W of an actuator disc, momentum theory.

    Parameters
    ----------
    power : (n,) W, electric
    speed : (n,) m/s
    density : (n,) kg/m3
    efficiency : float
    area : float, m2, of the disc
    """
    received = np.maximum(efficiency * power, 0.0)
    # that of a disc at rest: never too small, so Newton comes down
    induced = np.cbrt(received / (2.0 * density * area))
    for _ in range(MAX_ITERATIONS):
        excess = 2.0 * density * area * (speed + induced) ** 2 * induced - received
        slope = 2.0 * density * area * (speed + induced) * (speed + 3.0 * induced)
        induced = induced - excess / slope
    return np.asarray(received * speed / (speed + induced))


@dataclass(frozen=True, eq=False)
class _Balance:
    """Residuals of the energy balance as forces, N, of a vector of unknowns."""

    blocks: Blocks
    area: float
    names: tuple[str, ...]

    def coefficients(self, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return CL, CD and dynamic pressure times area (n,)."""
        b, named = self.blocks, dict(zip(self.names, values, strict=True))
        speed = b.speed * named["airspeed"]
        pressure_area = 0.5 * b.density * speed**2 * self.area
        useful = np.zeros_like(speed)
        if b.powered:
            disc = 0.25 * np.pi * float(np.exp(2.0 * named["diameter"]))
            useful = useful_power(b.power, speed, b.density, float(named["efficiency"]), disc)
        drag = (useful - b.kinetic * named["airspeed"] ** 2 - b.potential) / speed
        return b.lift / pressure_area, drag / pressure_area, pressure_area

    def residual(self, values: FloatArray) -> FloatArray:
        """Return drag by the energy balance minus drag by the polar (n,), N."""
        CL, CD, pressure_area = self.coefficients(values)
        c0, c1, c2 = values[:3]
        return np.asarray((CD - (c0 + c1 * CL + c2 * CL**2)) * pressure_area)


def fit_polar(
    cut: Blocks, mass: float, area: float, airspeed_std: float, propulsion: Propulsion = Propulsion()
) -> Polar:
    """Fit the polar to blocks, robust against gusts.

    Parameters
    ----------
    cut : Blocks
    mass, area : float, kg, m2
    airspeed_std : float
        Relative standard error of the airspeed, common to all blocks.
    propulsion : Propulsion
    """
    free = np.nan
    rows = [("c0", 0.04, free), ("c1", 0.0, free), ("c2", 0.05, free), ("airspeed", 1.0, airspeed_std)]
    if cut.powered:
        diameter = propulsion.diameter or DISC * np.sqrt(area)
        spread = 0.02 if propulsion.diameter is not None else DISC_SPREAD  # one that was measured
        rows.append(("efficiency", propulsion.efficiency, propulsion.efficiency_std))
        rows.append(("diameter", float(np.log(diameter)), spread))
    names = tuple(name for name, _, _ in rows)
    mean, std = np.array([row[1:] for row in rows]).T.copy()
    balance, known = _Balance(cut, area, names), np.isfinite(std)
    scale = np.where(known, std, 1.0)
    values, weights, sigma = mean.copy(), np.ones(len(cut.time)), 1.0
    for _ in range(MAX_ITERATIONS):
        before, root = values, np.sqrt(weights) / sigma

        def weighted(x: FloatArray, root: FloatArray = root) -> FloatArray:
            return np.concatenate([root * balance.residual(x), ((x - mean) / scale)[known]])

        values = np.asarray(least_squares(weighted, values, x_scale=np.where(known, std, 0.05)).x)
        left = balance.residual(values)
        sigma = robust_std(left) or 1.0
        weights = np.minimum(1.0, HUBER * sigma / np.maximum(np.abs(left), 1e-12))
        if float(np.max(np.abs(values - before))) < 1e-8:
            break
    # the covariance is corrected for color, stretch by stretch
    root, left = np.sqrt(weights) / sigma, balance.residual(values)
    steps = STEP * np.eye(len(values))
    slopes = np.column_stack(
        [(balance.residual(values + h) - balance.residual(values - h)) / (2.0 * STEP) for h in steps]
    )
    parts = [np.flatnonzero(cut.stretch == s) for s in np.unique(cut.stretch)]
    segments = [
        PieceEvidence((root * left)[part][:, None], (root[:, None] * -slopes)[part][:, None, :])
        for part in parts
        if part.size > 1
    ]
    covariance = estimate_uncertainty(segments, np.diag(np.where(known, std, np.inf) ** -2.0)).corrected
    CL, CD, _ = balance.coefficients(values)
    return Polar(cut, area, mass, names, values, covariance, std, CL, CD, weights)
