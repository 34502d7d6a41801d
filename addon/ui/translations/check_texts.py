# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of the panel Checks."""

from .lookup import LABEL, OPERATOR, SENTENCE

TABLE = {
    (LABEL, "Checks"): {"de_DE": "Prüfungen", "es": "Comprobaciones"},
    (LABEL, "Check"): {"de_DE": "Prüfung", "es": "Comprobación"},
    (SENTENCE, "UV islands: {}"): {"de_DE": "UV-Inseln: {}", "es": "Islas UV: {}"},
    (SENTENCE, "Over {}; 99 % within {}, at most {}"): {
        "de_DE": "> {}; 99 % < {}; ≤ {}",
        "es": "> {}; 99 % < {}; ≤ {}",
    },
    (LABEL, "Overlapping UVs"): {"de_DE": "Überlappende UVs", "es": "UV superpuestas"},
    (
        SENTENCE,
        "Texels that two or more triangles of the low mesh share: they show only one of them. Parts at exactly the "
        "same place, such as mirrored halves, share their detail on purpose and do no harm in tangent space",
    ): {
        "de_DE": "Texel, die sich zwei oder mehr Dreiecke des Low-Poly-Meshes teilen: Sie zeigen nur eines davon. "
        "Teile an genau derselben Stelle, etwa gespiegelte Hälften, teilen ihre Details mit Absicht und "
        "schaden im Tangentenraum nicht",
        "es": "Texels que comparten dos o más triángulos de la malla low poly: sólo muestran uno de ellos. Las "
        "partes en exactamente el mismo lugar, como mitades reflejadas, comparten su detalle a propósito y "
        "no son un problema en espacio tangencial",
    },
    (LABEL, "Uncovered"): {"de_DE": "Nicht abgedeckt", "es": "Sin cubrir"},
    (SENTENCE, "Texels of the low mesh that no high triangle covers, or whose ray hit nothing"): {
        "de_DE": "Texel des Low-Poly-Meshes, die kein High-Poly-Dreieck bedeckt oder deren Strahl nichts getroffen hat",
        "es": "Texels de la malla low poly que ningún triángulo high poly cubre, o cuyo rayo no alcanzó nada",
    },
    (LABEL, "Far"): {"de_DE": "Weit entfernt", "es": "Lejos"},
    (SENTENCE, "Texels whose points on the low and the high mesh are farther apart than the limit"): {
        "de_DE": "Texel, deren Punkte auf Low-Poly- und High-Poly-Mesh weiter voneinander entfernt sind als die Grenze",
        "es": "Texels cuyos puntos en las mallas low poly y high poly están más separados que el límite",
    },
    (LABEL, "Unsure layers"): {"de_DE": "Unsichere Ebenen", "es": "Capas dudosas"},
    (
        SENTENCE,
        "Texels that may show the wrong layer of the high mesh: their rays hit several layers, and the low mesh does not "
        "tell which of them belongs to the texel",
    ): {
        "de_DE": "Texel, die möglicherweise die falsche Ebene des High-Poly-Meshes zeigen: Ihre Strahlen treffen mehrere "
        "Ebenen, und das Low-Poly-Mesh entscheidet nicht, welche davon zum Texel gehört",
        "es": "Texels que quizás muestran la capa equivocada de la malla high poly: sus rayos alcanzan varias capas, y la "
        "malla low poly no decide cuál de ellas pertenece al texel",
    },
    (SENTENCE, "No own hit: {}"): {"de_DE": "Kein eigener Treffer: {}", "es": "Sin impacto propio: {}"},
    (SENTENCE, "Only backs: {}"): {"de_DE": "Nur Rückseiten: {}", "es": "Sólo dorsos: {}"},
    (SENTENCE, "Two own hits: {}"): {"de_DE": "Zwei eigene Treffer: {}", "es": "Dos impactos propios: {}"},
    (SENTENCE, "Jumps: {}"): {"de_DE": "Sprünge: {}", "es": "Saltos: {}"},
    (SENTENCE, "Not the own hit: {}"): {"de_DE": "Nicht der eigene Treffer: {}", "es": "No es el impacto propio: {}"},
    (LABEL, "Close islands"): {"de_DE": "Nahe Inseln", "es": "Islas cercanas"},
    (
        SENTENCE,
        "Texels so close to another UV island, or to the border of the map, that the smaller mip levels mix them. "
        "Clean Mips, below the margin, sets the number of levels",
    ): {
        "de_DE": "Texel, die so nahe an einer anderen UV-Insel oder am Bildrand liegen, dass die kleineren "
        "Mip-Stufen sie mischen. Saubere Mips, unter dem Rand, legt die Anzahl der Stufen fest",
        "es": "Texels tan cercanos a otra isla UV, o al límite del mapa, que los niveles mip menores los "
        "mezclan. Mips limpios, debajo del margen, define la cantidad de niveles",
    },
    (LABEL, "Z below 0"): {"de_DE": "Z unter 0", "es": "Z menor que 0"},
    (
        SENTENCE,
        "Texels whose tangent-space normal points into the surface: lost by readers that store x and y and rebuild z",
    ): {
        "de_DE": "Texel, deren Normale im Tangentenraum in die Oberfläche zeigt: Sie geht verloren, wenn nur x und "
        "y gespeichert und z daraus berechnet wird",
        "es": "Texels cuya normal en espacio tangencial apunta hacia dentro de la superficie: se pierde si sólo "
        "se guardan x e y, y z se reconstruye",
    },
    (LABEL, "Mirrored UVs"): {"de_DE": "Gespiegelte UVs", "es": "UV reflejadas"},
    (SENTENCE, "Triangles that are mirrored in UV space: common practice, which readers of the map must support"): {
        "de_DE": "Dreiecke, die im UV-Raum gespiegelt sind: üblich, aber die Zielanwendung der Map muss es "
        "unterstützen",
        "es": "Triángulos reflejados en el espacio UV: práctica habitual, que el programa que lea el mapa debe admitir",
    },
    (LABEL, "Outside the tile"): {"de_DE": "Außerhalb der Kachel", "es": "Fuera de la celda"},
    (
        SENTENCE,
        "Triangles that reach outside the UV tile, or the UDIM tiles, and are cut off there. Parts that were moved "
        "by whole tiles, such as mirrored halves, do no harm",
    ): {
        "de_DE": "Dreiecke, die über die UV-Kachel oder die UDIM-Kacheln hinausreichen und dort abgeschnitten "
        "werden. Teile, die um ganze Kacheln verschoben wurden, etwa gespiegelte Hälften, schaden nicht",
        "es": "Triángulos que se salen de la celda UV, o de las celdas UDIM, y se cortan allí. Las partes "
        "desplazadas en celdas enteras, como mitades reflejadas, no son un problema",
    },
    (LABEL, "Zero-area UVs"): {"de_DE": "UVs ohne Fläche", "es": "UV sin área"},
    (SENTENCE, "Triangles without area in UV space, which cannot be drawn"): {
        "de_DE": "Dreiecke ohne Fläche im UV-Raum, die nicht gezeichnet werden können",
        "es": "Triángulos sin área en el espacio UV, que no pueden dibujarse",
    },
    (LABEL, "Hard edges, no seam"): {"de_DE": "Harte Kanten, keine Naht", "es": "Bordes duros sin costura"},
    (
        SENTENCE,
        "Hard edges inside a UV island: each shows as a line in tangent space. Mark a seam there and unwrap, "
        "or shade smooth",
    ): {
        "de_DE": "Harte Kanten innerhalb einer UV-Insel: Jede hinterlässt im Tangentenraum eine sichtbare Linie. "
        "Dort eine Naht markieren und auspacken oder weich schattieren",
        "es": "Bordes duros dentro de una isla UV: cada uno deja una línea visible en espacio tangencial. Marcar "
        "allí una costura y desplegar, o sombrear suave",
    },
    (LABEL, "Normals behind"): {"de_DE": "Normalen nach hinten", "es": "Normales hacia atrás"},
    (SENTENCE, "Triangles with a shading normal that points behind them, where no tangent-space map can be right"): {
        "de_DE": "Dreiecke mit einer Shading-Normalen, die hinter sie zeigt: Dort kann keine Map im Tangentenraum "
        "stimmen",
        "es": "Triángulos con una normal de sombreado que apunta detrás de ellos, donde ningún mapa en espacio "
        "tangencial puede ser correcto",
    },
    (LABEL, "Quads, n-gons"): {"de_DE": "Quads, N-Gons", "es": "Quads, enégonos"},
    (SENTENCE, "Faces with more than three corners: an exporter may divide them into other triangles"): {
        "de_DE": "Flächen mit mehr als drei Ecken: Ein Exporter kann sie in andere Dreiecke zerlegen",
        "es": "Caras con más de tres esquinas: un exportador podría dividirlas en otros triángulos",
    },
    (LABEL, "Non-planar faces"): {"de_DE": "Unebene Flächen", "es": "Caras no planas"},
    (SENTENCE, "Quads and n-gons whose shape depends on how they are divided into triangles"): {
        "de_DE": "Quads und N-Gons, deren Form davon abhängt, wie sie in Dreiecke zerlegt werden",
        "es": "Quads y enégonos cuya forma depende de cómo se dividan en triángulos",
    },
    (SENTENCE, "Name of a low object that was baked; empty for that of the panel, or else the last one"): {
        "de_DE": "Name eines gebackenen Low-Poly-Objekts; leer für das des Panels oder sonst das letzte",
        "es": "Nombre de un objeto low poly ya capturado; vacío para el del panel o, si no, el último",
    },
    (OPERATOR, "Select Faces"): {"de_DE": "Flächen auswählen", "es": "Seleccionar caras"},
    (SENTENCE, "Select the faces of the low object that the check has found, in Edit Mode"): {
        "de_DE": "Die Flächen des Low-Poly-Objekts, die die Prüfung gefunden hat, im Bearbeitungsmodus auswählen",
        "es": "Selecciona las caras del objeto low poly que encontró la comprobación, en Modo Edición",
    },
    (SENTENCE, "Select the faces in Edit Mode"): {
        "de_DE": "Die Flächen im Bearbeitungsmodus auswählen",
        "es": "Selecciona las caras en Modo Edición",
    },
    (SENTENCE, "The check whose faces to select"): {
        "de_DE": "Die Prüfung, deren Flächen ausgewählt werden",
        "es": "La comprobación cuyas caras se seleccionarán",
    },
    (OPERATOR, "Show Mask"): {"de_DE": "Maske anzeigen", "es": "Mostrar máscara"},
    (SENTENCE, "Make an image that is white on the texels that the check has found"): {
        "de_DE": "Ein Bild erzeugen, das auf den von der Prüfung gefundenen Texeln weiß ist",
        "es": "Crea una imagen que es blanca en los texels que encontró la comprobación",
    },
    (SENTENCE, "Show them white in an image"): {
        "de_DE": "Sie in einem Bild weiß anzeigen",
        "es": "Los muestra en blanco en una imagen",
    },
    (SENTENCE, "The check whose texels to show"): {
        "de_DE": "Die Prüfung, deren Texel angezeigt werden",
        "es": "La comprobación cuyos texels se mostrarán",
    },
    (OPERATOR, "Add Triangulate"): {"de_DE": "Triangulieren hinzufügen", "es": "Adicionar Triangular"},
    (
        SENTENCE,
        "Add a modifier that divides the low object's faces into the triangles that were baked, so that exporters "
        "use the same",
    ): {
        "de_DE": "Einen Modifikator hinzufügen, der die Flächen des Low-Poly-Objekts in die gebackenen Dreiecke "
        "zerlegt, damit Exporter dieselben verwenden",
        "es": "Adiciona un modificador que divide las caras del objeto low poly en los triángulos que se "
        "capturaron, para que los exportadores usen los mismos",
    },
}
