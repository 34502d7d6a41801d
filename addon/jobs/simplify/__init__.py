# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes coarser meshes, and judges them: for levels of detail and game assets. core/simplify.py searches among them."""
