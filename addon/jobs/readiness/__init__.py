# SPDX-License-Identifier: GPL-3.0-or-later
"""What is wrong with a low object for other programs, before it is baked, and what cures it."""
