"""The vehicle."""

from __future__ import annotations

from pathlib import Path

import panel as pn

from stoop.app import parts
from stoop.app.view import View
from stoop.errors import StoopError
from stoop.vehicle.builtin import BUILT_IN, builtin_text, builtin_title
from stoop.vehicle.load import load_vehicle


class VehicleView(View):
    """Get or make a vehicle, and edit its numbers."""

    title = "Vehicle"

    def refresh(self) -> None:
        """Show the choice, or the vehicle."""
        self.body[:] = self._choice()

    def _choice(self):
        path = pn.widgets.TextInput(name="path of a vehicle file on this machine", placeholder="examples/vtail.toml", margin=(4,8,4,0))
        def opened():
            p = Path(path.value_input.strip())
            self.take(load_vehicle(p).text)
        path.param.watch(lambda e: self.act(opened)(), "enter_pressed")
        built = [parts.button(n, self.act(lambda n=n: self.take(builtin_text(n)))) for n in BUILT_IN]
        return [pn.Row(path, parts.button("Use", self.act(opened), "primary", align="end")), pn.FlexBox(*built), parts.html(f"<pre>{parts.escaped(self.project.vehicle)}</pre>")]

    def take(self, text):
        self.project.save_vehicle(text, None)
        if self.project.info:
            self.project.propose_windows()
            self.go("Windows")
