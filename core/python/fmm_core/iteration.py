# SPDX-License-Identifier: GPL-3.0-or-later
"""The iteration that the settings choose."""

from .krylov import gmres
from .shooting import shoot

#: Functions of the exchange, the scene, the particles, the settings, the report and a tick, by name.
ITERATIONS = {"krylov": gmres, "shooting": shoot}
