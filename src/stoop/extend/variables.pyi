from stoop.base.autopilots import ARDUPILOT as ARDUPILOT
from stoop.base.autopilots import PX4 as PX4
from stoop.base.variables import EFFECTS as EFFECTS
from stoop.base.variables import FAMILIES as FAMILIES
from stoop.base.variables import VARIABLES as VARIABLES
