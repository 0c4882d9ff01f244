from stoop.errors import FlightError as FlightError
from stoop.errors import IdentificationError as IdentificationError
from stoop.errors import LogError as LogError
from stoop.errors import ManeuverError as ManeuverError
from stoop.errors import OutputError as OutputError
from stoop.errors import SimulationError as SimulationError
from stoop.errors import StoopError as StoopError
from stoop.errors import VehicleError as VehicleError
