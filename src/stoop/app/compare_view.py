"""Compare."""
from stoop.app import parts
from stoop.app.view import View

class CompareView(View):
    title = "Compare"
    def refresh(self):
        self.body[:] = [parts.html("")]
