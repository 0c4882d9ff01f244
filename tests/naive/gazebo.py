"""Gazebo's systems as their sources compute them, read from a model file: one step of plain vectors after another.

Everything is along the model's axes, forward, left and up, with the base link at the origin. AdvancedLiftDrag is written with
its stability axes as vectors, dimensional rates and joint angles in degrees; `fixed` is whether the pitching moment keeps its
constant and slope. The lag of motors is the exact one of a command that is held over a step, with its two time constants.

References
----------
gz-sim, branch gz-sim8: AdvancedLiftDrag.cc, MulticopterMotorModel.cc, HydrodynamicsUtils.hh, LiftDrag.cc.
"""

import math
from xml.etree import ElementTree as ET

Vector = list[float]


def plus(*vectors: Vector) -> Vector:
    return [sum(parts) for parts in zip(*vectors, strict=True)]


def times(k: float, a: Vector) -> Vector:
    return [k * x for x in a]


def dot(a: Vector, b: Vector) -> float:
    return sum(x * y for x, y in zip(a, b, strict=True))


def cross(a: Vector, b: Vector) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def length(a: Vector) -> float:
    return math.sqrt(dot(a, a))


def turned(rpy: Vector, a: Vector) -> Vector:
    """Turn a vector of a link into the model's axes: about x, then y, then z."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(x), math.sin(x)) for x in rpy)
    x, y, z = a
    y, z = cr * y - sr * z, sr * y + cr * z
    x, z = cp * x + sp * z, -sp * x + cp * z
    return [cy * x - sy * y, sy * x + cy * y, z]


class Model:
    """A model file; loads are force and moment about the origin of the base link."""

    def __init__(self, text: str, fixed: bool = False) -> None:
        self.model = ET.fromstring(text).find("model")  # noqa: S314 - our own
        self.fixed = fixed
        self.angles: dict[str, float] = {}  # of joints, rad
        self.speeds: dict[str, float] = {}  # of rotors, rad/s, as fast as they really turn

    def systems(self, name: str) -> list[ET.Element]:
        return [p for p in self.model.findall("plugin") if p.get("name") == f"gz::sim::systems::{name}"]

    def pose(self, link: str) -> tuple[Vector, Vector]:
        text = self.model.find(f"link[@name='{link}']").findtext("pose") or "0 0 0 0 0 0"
        numbers = [float(x) for x in text.split()]
        return numbers[:3], numbers[3:]

    def loads(self, velocity: Vector, rates: Vector) -> tuple[Vector, Vector]:
        force, moment = [0.0] * 3, [0.0] * 3
        for system, compute in (("AdvancedLiftDrag", self.wing), ("Hydrodynamics", self.damping),
                                ("MulticopterMotorModel", self.motor)):  # fmt: skip
            for plugin in self.systems(system):
                f, m = compute(plugin, velocity, rates)
                force, moment = plus(force, f), plus(moment, m)
        return force, moment

    def wing(self, plugin: ET.Element, velocity: Vector, rates: Vector) -> tuple[Vector, Vector]:
        def n(name: str) -> float:
            return float(plugin.findtext(name) or 0.0)

        def vector(name: str) -> Vector:
            return [float(x) for x in plugin.findtext(name).split()]

        cp = vector("cp")
        air = plus(velocity, cross(rates, cp))
        x_axis, z_axis = vector("forward"), times(-1.0, vector("upward"))
        y_axis = cross(z_axis, x_axis)
        in_plane = plus(air, times(-dot(air, y_axis), y_axis))
        speed = length(in_plane)
        if speed <= 1e-9:
            return [0.0] * 3, [0.0] * 3
        stability_x = times(1.0 / speed, in_plane)
        stability_z = cross(stability_x, y_axis)
        span, mac, area, rho = math.sqrt(n("area") * n("AR")), n("mac"), n("area"), n("air_density")
        roll_rate, pitch_rate, yaw_rate = rates[0], -rates[1], -rates[2]
        alpha = math.atan2(dot(stability_x, z_axis), dot(stability_x, x_axis))
        beta = math.atan2(dot(air, y_axis), dot(air, x_axis))
        pressure, half = 0.5 * rho * speed**2, 0.5 * rho * speed
        stall, M = n("alpha_stall"), 15.0
        above, below = math.exp(-M * (alpha - stall)), math.exp(M * (alpha + stall))
        sigma = (1 + above + below) / ((1 + above) * (1 + below))
        controls = {}
        for name in ("CL", "CD", "CY", "Cell", "Cem", "Cen"):
            controls[name] = 0.0
            for s in plugin.findall("control_surface"):
                degrees = math.degrees(self.angles[s.findtext("name")])
                controls[name] += degrees * float(s.findtext(f"{name}_ctrl")) * float(s.findtext("direction"))

        def by_rates(name: str) -> float:
            terms = (
                (n(f"{name}p"), roll_rate * span),
                (n(f"{name}q"), pitch_rate * mac),
                (n(f"{name}r"), yaw_rate * span),
            )
            return sum(c * rate / 2 * half for c, rate in terms)

        plate = 2 * (alpha / abs(alpha)) * math.sin(alpha) ** 2 * math.cos(alpha)
        CL = (1 - sigma) * (n("CL0") + n("CLa") * alpha) + sigma * plate + n("CLb") * beta + controls["CL"]
        lift = times(-(CL * pressure + by_rates("CL")) * area, stability_z)
        flat = 2 / (1 + math.exp(-0.224 - 0.115 * max(n("AR"), 1 / n("AR"))))
        CD = (1 - sigma) * (n("CD0") + CL**2 / (math.pi * n("AR") * n("eff")))
        CD += sigma * abs(flat * (0.5 - 0.5 * math.cos(2 * alpha))) + controls["CD"]
        drag = times(-(CD * pressure + by_rates("CD")) * area, stability_x)
        CY = n("CYa") * alpha + n("CYb") * beta + controls["CY"]
        side = times((CY * pressure + by_rates("CY")) * area, y_axis)
        Cem = n("Cem0") + n("Cema") * alpha if self.fixed else 0.0
        Cem += n("Cemb") * beta + controls["Cem"]
        Cell = n("Cella") * alpha + n("Cellb") * beta + controls["Cell"]
        Cen = n("Cena") * alpha + n("Cenb") * beta + controls["Cen"]
        moment = plus(
            times((Cem * pressure + by_rates("Cem")) * area * mac, y_axis),
            times((Cell * pressure + by_rates("Cell")) * area * span, x_axis),
            times((Cen * pressure + by_rates("Cen")) * area * span, z_axis),
        )
        force = plus(lift, drag, side)
        return force, plus(moment, cross(cp, force))

    def damping(self, plugin: ET.Element, velocity: Vector, rates: Vector) -> tuple[Vector, Vector]:
        state, out = [*velocity, *rates], []
        for load in "xyzkmn":
            total = 0.0
            for j, motion in enumerate("UVWPQR"):
                entry = -float(plugin.findtext(f"{load}{motion}") or 0.0)
                for k, other in enumerate("UVWPQR"):
                    entry -= float(plugin.findtext(f"{load}{motion}abs{other}") or 0.0) * abs(state[k])
                total += entry * state[j]
            out.append(-total)
        return out[:3], out[3:]

    def motor(self, plugin: ET.Element, velocity: Vector, rates: Vector) -> tuple[Vector, Vector]:
        link = plugin.findtext("linkName")
        speed = self.speeds[link]
        turning = 1 if plugin.findtext("turningDirection") == "ccw" else -1
        place, rpy = self.pose(link)
        axis = turned(rpy, [0.0, 0.0, 1.0])
        thrust = float(plugin.findtext("motorConstant")) * speed**2
        local = plus(velocity, cross(rates, place))
        across = plus(local, times(-dot(local, axis), axis))
        drag = times(-abs(speed) * float(plugin.findtext("rotorDragCoefficient")), across)
        rolling = times(-abs(speed) * float(plugin.findtext("rollingMomentCoefficient")), across)
        torque = turned(rpy, [0.0, 0.0, -turning * thrust * float(plugin.findtext("momentConstant"))])
        force = plus(times(thrust, axis), drag)
        return force, plus(cross(place, force), torque, rolling)

    def follow(self, commands: dict[str, float], dt: float) -> None:
        """Let rotors follow commanded speeds, rad/s, held over a step."""
        for plugin in self.systems("MulticopterMotorModel"):
            link = plugin.findtext("linkName")
            wanted = min(commands[link], float(plugin.findtext("maxRotVelocity")))
            up = wanted > self.speeds[link]
            rest = math.exp(-dt / float(plugin.findtext("timeConstantUp" if up else "timeConstantDown")))
            self.speeds[link] = rest * self.speeds[link] + (1 - rest) * wanted

    def blades(
        self, link: str, speed: float, azimuth: float, velocity: Vector, rates: Vector
    ) -> tuple[Vector, Vector]:
        """Return the loads of LiftDrag's blades on a link that turns about its z axis, rad/s, at an azimuth."""
        place, rpy = self.pose(link)
        force, moment = [0.0] * 3, [0.0] * 3
        spin = plus(rates, times(speed, turned(rpy, [0.0, 0.0, 1.0])))
        origin = plus(velocity, cross(rates, place))
        for plugin in self.systems("LiftDrag"):
            if plugin.findtext("link_name") != link:
                continue

            def vector(name: str, plugin: ET.Element = plugin) -> Vector:
                text = plugin.findtext(name).split()
                return turned(rpy, turned([0.0, 0.0, azimuth], [float(x) for x in text]))

            cp, ahead, up = vector("cp"), vector("forward"), vector("upward")
            air = plus(origin, cross(spin, cp))
            if dot(ahead, air) <= 0.0:
                continue
            wise = cross(ahead, up)
            in_plane = plus(air, times(-dot(air, wise), wise))
            sweep = dot(wise, air) / length(air)
            drag_axis = times(-1.0 / length(in_plane), in_plane)
            lift_axis = times(1.0 / length(in_plane), cross(wise, in_plane))
            apart = math.acos(min(dot(lift_axis, up), 1.0))
            alpha = float(plugin.findtext("a0")) + (apart if dot(lift_axis, ahead) >= 0.0 else -apart)
            pressure = (
                0.5
                * float(plugin.findtext("air_density"))
                * dot(in_plane, in_plane)
                * float(plugin.findtext("area"))
            )
            pressure *= 1.0 - sweep**2
            cl, cd = float(plugin.findtext("cla")) * alpha, abs(float(plugin.findtext("cda")) * alpha)
            f = plus(times(cl * pressure, lift_axis), times(cd * pressure, drag_axis))
            force, moment = plus(force, f), plus(moment, cross(plus(place, cp), f))
        return force, moment
