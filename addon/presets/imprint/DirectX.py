# SPDX-License-Identifier: GPL-3.0-or-later
import bpy

settings = bpy.context.scene.imprint

settings.red = "+X"
settings.green = "-Y"
settings.blue = "+Z"
settings.basis = "MIKKTSPACE"
settings.depth = "16"
settings.alpha = False
settings.names = "{low}_normal"
