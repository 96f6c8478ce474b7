# SPDX-License-Identifier: Apache-2.0
"""What an export could not take along. Each is told once, with the names of the things that have it."""


class ExportError(Exception):
    """Nothing was exported: the message says what is wrong and what to do."""


class Notes:
    def __init__(self):
        self._names: dict[str, list[str]] = {}

    def add(self, what: str, name: str):
        names = self._names.setdefault(what, [])
        if name not in names:
            names.append(name)

    def lines(self) -> list[str]:
        """For example: "Spot, Spot.001: spot lamps are not exported"."""
        most = 8
        return [f"{', '.join(names[:most])}{f' and {len(names) - most} more' if len(names) > most else ''}: {what}"
                for what, names in self._names.items()]
