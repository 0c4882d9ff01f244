from stoop.parallel.loop import execute as execute
from stoop.parallel.plan import Plan as Plan
from stoop.parallel.plan import Run as Run
from stoop.parallel.store import forget as forget
from stoop.parallel.worker import environment as environment
