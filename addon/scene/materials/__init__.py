# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads materials: what feeds the sockets of their shaders."""
