# SPDX-License-Identifier: GPL-3.0-or-later
"""What a texel loses: the roughness of detail that is finer than a texel, and mip levels."""
