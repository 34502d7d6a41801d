# SPDX-License-Identifier: GPL-3.0-or-later
"""Small binary USD files."""

import base64
import zlib

SUBLAYER = (
    "eNoLiAjSDQ12cWbgYACDeYwMVAGMONgI8MGeHcqygdJWMKmv3Na6mgwMevoFiUUleqXFKYkMxaVJPomVqUXFXAwfuPzT0opTS4oZivLzSxhSUtMSS3NKAo"
    "oyc+E2MQExM5TNCTO1ACQiwsgkARNQiABqMDBiSGFn2MBgyMAKFuR2YMHQCDLWkeEvI5p/YO5nCEDjMqJy//3//5+wJjQumMUG5YX4e7v6BSPCrgZKB0Hp"
    "4JAgTz93hIJzUJoHSrt5uvq4IOm/BaUtUeRdQ2BKhKGulYS5xjHEA0k7gw5U3hZmf4CrM7J8JlTeFMoHAH7sMkY="
)
REFERENCE = (
    "eNoLiAjSDQ12cWbgYACDXYwMVAEwY5iAWIERiwQCfLCHsaBuYLCA0tZwJZrWupoMDIkMBUWZuc4ZmTkpRal5DMUFqcmZaZmpRQwFiUUleqXFKYkMRfn5JQ"
    "xFqWmpQAXJqcVw61iBmBnNGoYEkAgLowSMrxABVC+gycpwAcjRckgBCyqD9YIAD0zdApCvXBkZ/jP+hZkJozlhagpAagQZ/iMsAzlFgAWhAMQX/P+PCcNV"
    "TOBgws1nB7n6PxuUG+Lv7eoXjAjOXigNEwoOCfL0c0coeIDmGzdPVx8XJP1v0CIBIu8aAlOiAg1SGSg/wDHEA0k7gwNU3glmf4CrM7J8EyOq+QAsIDWx"
)
CLIPS = (
    "eNoLiAjSDQ12cWbgYAADDiYGqgBGKM2ExAYBCyRxmDoOFDEuB2YkMRaoWAWYlmfghopHQOlImMEfxax1NRkYEhkKijJznTMyc1KKUvMYigtSkzPTMlOLGF"
    "JS0xJLc0rkGT6yBSSWZDDoJzKUpOYW5CSWpDoWF6eWiDJ8YNXTT87JLNBTVtYrLU5hALGLGVih5oNoNiBmhzqOE4iZoXKcMEcUgFSwMjNKwAQUIoA+FNBk"
    "ZbgA5Gg5pEB9ATOUB6ZuAcjvrowM/xn/MqGFECwkGBIYweHFDuMHgMMVwf0PBDh1IfhMaHyQASz/2aDcEH9vV79gRHxtgNKFUDo4JMjTzx2hQBEauTJQvp"
    "unq48Lkn5bqLwlirxrCExJGZr+AMcQDyTtDJOg8nYw+wNcnZHlLzCipisA0EA+/g=="
)
"""Files that refer to part.usda by a sublayer and by a reference, and to others by a template of clips. usd-core
wrote them; they are compressed, in base 64."""


def binary(text):
    return zlib.decompress(base64.b64decode(text))
