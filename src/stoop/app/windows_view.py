"""The windows."""
from __future__ import annotations
import panel as pn
from stoop.app import parts, steps
from stoop.app.plots import Strips, read_flight
from stoop.app.view import View

class WindowsView(View):
    title = "Windows"
    def refresh(self):
        p = self.project
        step = p.latest("maneuvers")
        if step is not None and step.running:
            self.body[:] = self.waiting(step, "choosing windows by their information")
            return
        rows = [(f"{w.start:g}", f"{w.stop:g}", w.use if w.accept else "not used", w.axis, w.why) for w in p.windows]
        self.body[:] = [parts.button("Run the fit", self.act(self.fit), "primary"), parts.html(parts.table(("start", "stop", "use", "axis", "why"), rows))]
    def fit(self):
        self.project.identify()
        self.go("Fit")
