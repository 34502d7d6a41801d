# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole bakes, from Blender's objects to images and materials.

bake_pair bakes one low object, bake_all several jobs. Both return reports when all is done. work does the same as a
generator: Blender can continue between its steps. A Job refers to the objects of one bake; jobs_by_name finds jobs by the
objects' names. All raise BakeError for objects or settings that cannot be baked.
"""

from .bake_jobs import bake_all, bake_pair, work
from .job import Job, Wants, jobs_by_name

__all__ = ["Job", "Wants", "bake_all", "bake_pair", "jobs_by_name", "work"]
