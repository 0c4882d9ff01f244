"""Use."""
from stoop.app import parts
from stoop.app.view import View

class UseView(View):
    title = "Use"
    def refresh(self):
        self.body[:] = [parts.html("")]
