# SPDX-License-Identifier: GPL-3.0-or-later
"""How far the stages of a bake are from the time to copy their bytes."""

from scripts.bench.contenders.names import CAST, FLATTEN


def limit(row: dict, gigabytes_per_second: float) -> dict:
    """Compare the stages of Flatten and Cast in a row of pairs.time_pair with the time to copy the bytes that each must move.

    A texel has 16 bytes, a corner 32 (position, normal, UV). Each byte is read once and written once.
    """
    corners, texels = 2 * 3 * 32, 2 * 16 * row["size"] ** 2
    least = {
        "extract": (row["high"] + row["low"]) * corners,
        "tree": row["high"] * corners,
        "upload": row["high"] * corners,
        "draw": texels,
        "read": texels,
        "audit": texels,
        "image": texels,
    }
    methods = {}
    for name in (FLATTEN, CAST):
        stages = dict(row["times"][name]["stages"])
        if not stages:
            continue
        total = stages.pop("total")
        methods[name] = {
            "total": total,
            "stages": {
                stage: {
                    "seconds": seconds,
                    "bytes": least.get(stage, 0),
                    "least_seconds": least.get(stage, 0) / gigabytes_per_second / 1e9,
                }
                for stage, seconds in stages.items()
                if seconds
            },
        }
    return {
        "pair": row["pair"],
        "size": row["size"],
        "gigabytes_per_second": gigabytes_per_second,
        "methods": methods,
    }
