# SPDX-License-Identifier: Apache-2.0
"""Notes on features that an export does not support, each reported once with the names of the objects."""


class ExportError(Exception):
    """The export failed. The message says what is wrong and what to do."""


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
