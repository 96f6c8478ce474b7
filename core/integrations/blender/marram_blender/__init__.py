# SPDX-License-Identifier: Apache-2.0
"""Marram in Blender: a render engine, and wind on hair for all engines. See ../README.md."""
bl_info = {
    "name": "Marram",
    "author": "Marram's authors",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "Properties > Render",
    "description": "Renders by Marram; wind on hair, brought back as curves",
    "category": "Render",
}

try:
    import numpy  # noqa: F401: Debian's Blender does not bring it along
except ImportError as error:
    raise ImportError("Marram's add-on needs numpy: install python3-numpy") from error

from . import engine, operators, panels, properties  # noqa: E402

MODULES = (properties, engine, operators, panels)


def register():
    for module in MODULES:
        module.register()


def unregister():
    for module in reversed(MODULES):
        module.unregister()
