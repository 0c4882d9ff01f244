"""Use all that the package adds: python use.py MANEUVER.toml; it writes into the present folder."""

import sys

import stoop
from stoop.cli.main import main

main(["speeds", "twin-boom"])
main(["export", "quad-x", "--to", "numbers", "-o", "out"])
vehicle = stoop.load_vehicle("twin-boom")
free = {p.name: {"free": p.name in ("Cmalpha", "Cmq", "Cmelevator")} for p in vehicle.parameters}
flight = stoop.simulate_flight(vehicle, stoop.load_maneuver(sys.argv[1]))
settings = {"method": "anchored", "optimizer": "nelder-mead", "generations": 2}
strategy = stoop.Strategy.only("long-windows")
fit = stoop.fit(vehicle.with_numbers(free), flight, [(0, 0.5), (0.5, 30)], strategy=strategy, **settings)
fit.save("fit")
read = stoop.load("fit")
print([one.done for one in read.result.decisions if one.state == "applied"], read.parameters["Cmq"].prior_std)
