from stoop.base.atmosphere import SEA_LEVEL_DENSITY as SEA_LEVEL_DENSITY
from stoop.base.atmosphere import standard_density as standard_density
from stoop.base.units import STANDARD_GRAVITY as STANDARD_GRAVITY
from stoop.base.units import UNITS as UNITS
