"""The fits."""
from __future__ import annotations
import panel as pn, json
from stoop.app import parts, steps
from stoop.app.plots import Curves
from stoop.app.view import View

class FitView(View):
    title = "Fit"
    def refresh(self):
        p = self.project
        step = p.latest("runs")
        if step is None:
            self.body[:] = [parts.html("no run")]
        elif step.running:
            self.body[:] = self.waiting(step, "fitting")
        elif step.state == "failed":
            self.body[:] = [parts.html(parts.error(step.error))]
        else:
            self.body[:] = [parts.html(parts.frame(f"{step.name}/report.html", "report"))]
