"""What PX4 and ArduPilot call surfaces, motors and frames: their numbers, and where the motors of a frame stand.

Surfaces count positive as both autopilots count them: trailing edge up, of a vertical surface to the right. A share is the part
that a surface takes of the moment about an axis, nose up, right wing down and nose right positive.

References
----------
.. [1] PX4, src/modules/control_allocator/module.yaml: CA_SV_CSn_TYPE
.. [2] ArduPilot, libraries/SRV_Channel/SRV_Channel.h: SERVOn_FUNCTION
.. [3] ArduPilot, libraries/AP_Motors/AP_MotorsMatrix.cpp (angles clockwise from the nose, and turning)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

Spin = Literal["ccw", "cw"]
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Autopilot:
    """Numbers by which an autopilot calls outputs and frames."""

    surfaces: Mapping[
        int, tuple[str, Point]
    ]  #: kind of a surface -> its name, and its shares of roll, pitch and yaw
    motors: Mapping[int, int] = field(default_factory=dict)  #: function of an output -> number of the motor
    throttles: tuple[int, ...] = ()  #: functions of a plane's motor, of its left and of its right one
    #: class and type -> degrees clockwise from the nose and turning of motors 1, 2, ...
    frames: Mapping[tuple[int, int], tuple[tuple[float, Spin], ...]] = field(default_factory=dict)


CCW: Final[Spin] = "ccw"
CW: Final[Spin] = "cw"
#: CA_SV_CSn_TYPE; shares where the parameters give none
PX4: Final = Autopilot(
    surfaces={
        1: ("left aileron", (-0.5, 0.0, 0.0)), 2: ("right aileron", (0.5, 0.0, 0.0)),
        3: ("elevator", (0.0, 1.0, 0.0)), 4: ("rudder", (0.0, 0.0, 1.0)),
        5: ("left elevon", (-0.5, 0.5, 0.0)), 6: ("right elevon", (0.5, 0.5, 0.0)),
        7: ("left V-tail", (0.0, 0.5, 0.5)), 8: ("right V-tail", (0.0, 0.5, -0.5)),
        12: ("custom", (0.0, 0.0, 0.0)),
        13: ("left A-tail", (0.0, 0.5, -0.5)), 14: ("right A-tail", (0.0, 0.5, 0.5)),
        15: ("aileron", (1.0, 0.0, 0.0)),
    },
)  # fmt: skip
#: SERVOn_FUNCTION; of ailerons, elevator and rudder the command is that of the axis
ARDUPILOT: Final = Autopilot(
    surfaces={
        4: ("aileron", (1.0, 0.0, 0.0)), 19: ("elevator", (0.0, 1.0, 0.0)), 21: ("rudder", (0.0, 0.0, 1.0)),
        24: ("left flaperon", (0.5, 0.0, 0.0)), 25: ("right flaperon", (0.5, 0.0, 0.0)),
        77: ("left elevon", (-0.5, 0.5, 0.0)), 78: ("right elevon", (0.5, 0.5, 0.0)),
        79: ("left V-tail", (0.0, 0.5, 0.5)), 80: ("right V-tail", (0.0, 0.5, -0.5)),
    },
    motors={**{33 + k: 1 + k for k in range(8)}, **{82 + k: 9 + k for k in range(4)}},
    throttles=(70, 73, 74),
    frames={
        (1, 0): ((90, CCW), (-90, CCW), (0, CW), (180, CW)),
        (1, 1): ((45, CCW), (-135, CCW), (-45, CW), (135, CW)),
        (1, 3): ((45, CW), (-135, CW), (-45, CCW), (135, CCW)),
        (1, 12): ((135, CW), (45, CCW), (-135, CCW), (-45, CW)),
        (1, 13): ((45, CCW), (-45, CW), (-135, CCW), (135, CW)),
        (1, 14): ((45, CCW), (135, CW), (-135, CCW), (-45, CW)),
        (2, 0): ((0, CW), (180, CCW), (-120, CW), (60, CCW), (-60, CCW), (120, CW)),
        (2, 1): ((90, CW), (-90, CCW), (-30, CW), (150, CCW), (30, CCW), (-150, CW)),
        (3, 0): ((0, CW), (180, CW), (45, CCW), (135, CCW), (-45, CCW), (-135, CCW), (-90, CW), (90, CW)),
        (3, 1): ((22.5, CW), (-157.5, CW), (67.5, CCW), (157.5, CCW), (-22.5, CCW), (-112.5, CCW), (-67.5, CW),
                 (112.5, CW)),
        (4, 1): ((45, CCW), (-45, CW), (-135, CCW), (135, CW), (-45, CCW), (45, CW), (135, CCW), (-135, CW)),
    },
)  # fmt: skip
