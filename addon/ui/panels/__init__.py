# SPDX-License-Identifier: GPL-3.0-or-later
"""The panels of the "Imprint" tab. They draw properties and messages, and decide nothing."""
