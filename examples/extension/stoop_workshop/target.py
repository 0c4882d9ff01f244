"""A target of ``stoop export``: names, values and units of all free numbers."""

from dataclasses import dataclass

from stoop_export.exporter import Exported, Exporter


@dataclass(frozen=True, eq=False)
class Numbers(Exporter):
    """A table for a spreadsheet."""

    def files(self) -> Exported:
        """Return the table."""
        rows = [f"{p.name},{self.vehicle.value(p.name):.9g},{p.unit}" for p in self.vehicle.parameters]
        text = "\n".join(["parameter,value,unit", *rows, ""])
        return Exported({"numbers.csv": text.encode()}, "numbers.csv")
