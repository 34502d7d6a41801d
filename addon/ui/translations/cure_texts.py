# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of what is found before a bake, and of the buttons that cure it."""

from .lookup import LABEL, OPERATOR, SENTENCE

TABLE = {
    (
        SENTENCE,
        "{low} has {count:,} n-gons: exporters write no tangents for them, and other programs divide them into other triangles "
        "than this bake. Triangulate it before the bake.",
    ): {
        "de_DE": "{low} hat {count:,} N-Gons: Exporter schreiben für sie keine Tangenten, und andere Programme zerlegen sie in "
        "andere Dreiecke als dieses Backen. Vor dem Backen triangulieren.",
        "es": "{low} tiene {count:,} enégonos: los exportadores no escriben tangentes para ellos y otros programas los dividen "
        "en otros triángulos que esta captura. Triangular antes de capturar.",
    },
    (
        SENTENCE,
        "{low} has {count:,} quads that look different if another program divides them along the other diagonal. Triangulate "
        "it before the bake.",
    ): {
        "de_DE": "{low} hat {count:,} Quads, die anders aussehen, wenn ein anderes Programm sie entlang der anderen Diagonale "
        "teilt. Vor dem Backen triangulieren.",
        "es": "{low} tiene {count:,} quads que se ven distintos si otro programa los divide por la otra diagonal. Triangular "
        "antes de capturar.",
    },
    (
        SENTENCE,
        "The map is for the UV map {layer} of {low}, but {active} is the active one: exporters write the tangents of the "
        "active one.",
    ): {
        "de_DE": "Die Map ist für die UV-Map {layer} von {low}, aber {active} ist die aktive: Exporter schreiben die Tangenten "
        "der aktiven.",
        "es": "El mapa es para el mapa UV {layer} de {low}, pero el activo es {active}: los exportadores escriben las "
        "tangentes del activo.",
    },
    (
        SENTENCE,
        "{low} has {count:,} hard edges without a UV seam. Each shows as a line in tangent space: mark seams and unwrap there, "
        "or shade them smooth.",
    ): {
        "de_DE": "{low} hat {count:,} harte Kanten ohne UV-Naht. Jede zeigt sich im Tangentenraum als Linie: dort Nähte "
        "markieren und auspacken oder weich schattieren.",
        "es": "{low} tiene {count:,} bordes duros sin costura UV. Cada uno se ve como una línea en espacio tangencial: marcar "
        "allí costuras y desplegar, o sombrear suave.",
    },
    (
        SENTENCE,
        "{low} has {count:,} triangles that are mirrored onto others in UV space: the map shows the detail of one of the two. "
        "Moved by a whole tile, they read the detail of the others.",
    ): {
        "de_DE": "{low} hat {count:,} Dreiecke, die im UV-Raum gespiegelt auf anderen liegen: Die Map zeigt die Details eines "
        "der beiden. Um eine ganze Kachel verschoben, lesen sie die Details der anderen.",
        "es": "{low} tiene {count:,} triángulos reflejados sobre otros en el espacio UV: el mapa muestra el detalle de uno de "
        "los dos. Desplazados una celda entera, leen el detalle de los otros.",
    },
    (
        SENTENCE,
        "The faces of {flipped} point to the other side than those of {other}: flip its normals before the bake.",
    ): {
        "de_DE": "Die Flächen von {flipped} zeigen zur anderen Seite als die von {other}: die Normalen vor dem Backen "
        "umkehren.",
        "es": "Las caras de {flipped} apuntan al lado contrario que las de {other}: invertir las normales antes de "
        "capturar.",
    },
    (LABEL, "Flip Normals"): {"de_DE": "Normalen umkehren", "es": "Invertir normales"},
    (SENTENCE, "Flip the faces of the object that point to the wrong side"): {
        "de_DE": "Die Flächen des Objekts umkehren, die zur falschen Seite zeigen",
        "es": "Invierte las caras del objeto que apuntan al lado equivocado",
    },
    (LABEL, "Choose Auto"): {"de_DE": "Auto wählen", "es": "Elegir Automático"},
    (SENTENCE, "Set Method to Auto, which casts rays where the UV layouts differ"): {
        "de_DE": "Die Methode auf Auto setzen, die Strahlen wirft, wo die UV-Layouts sich unterscheiden",
        "es": "Pone el método en Automático, que lanza rayos donde las disposiciones UV difieren",
    },
    (LABEL, "Cast Rays"): {"de_DE": "Strahlen werfen", "es": "Lanzar rayos"},
    (SENTENCE, "Set Method to Cast, which needs no UVs of the high mesh"): {
        "de_DE": "Die Methode auf Strahlen setzen, die keine UVs des High-Poly-Meshes braucht",
        "es": "Pone el método en Proyectar, que no necesita las UV de la malla high poly",
    },
    (LABEL, "Use Own Hit"): {"de_DE": "Eigenen Treffer verwenden", "es": "Usar el impacto propio"},
    (SENTENCE, "Set Hit to Own, which chooses the layer that belongs to each texel"): {
        "de_DE": "Den Treffer auf Eigener setzen, der die Schicht wählt, die zu jedem Texel gehört",
        "es": "Pone el impacto en Propio, que elige la capa que corresponde a cada texel",
    },
    (
        SENTENCE,
        "Measure how far the high surface lies from the low one, instead of using distances that were set",
    ): {
        "de_DE": "Messen, wie weit die High-Poly-Oberfläche von der Low-Poly-Oberfläche entfernt ist, statt eingestellte "
        "Abstände zu verwenden",
        "es": "Mide a qué distancia está la superficie high poly de la low poly, en vez de usar distancias definidas",
    },
    (LABEL, "Use 32 Bits"): {"de_DE": "32 Bit verwenden", "es": "Usar 32 bits"},
    (SENTENCE, "Set Depth to 32, which holds larger values"): {
        "de_DE": "Die Tiefe auf 32 setzen, die größere Werte fasst",
        "es": "Pone la profundidad en 32, que admite valores mayores",
    },
    (LABEL, "Use 16 Samples"): {"de_DE": "16 Samples verwenden", "es": "Usar 16 muestras"},
    (SENTENCE, "Set Samples to 16"): {"de_DE": "Die Samples auf 16 setzen", "es": "Pone las muestras en 16"},
    (LABEL, "Switch Material Off"): {"de_DE": "Material ausschalten", "es": "Desactivar Material"},
    (SENTENCE, "Leave the materials of the low object as they are"): {
        "de_DE": "Die Materialien des Low-Poly-Objekts lassen, wie sie sind",
        "es": "Deja los materiales del objeto low poly como están",
    },
    (LABEL, "Use Texture Sets"): {"de_DE": "Textursätze verwenden", "es": "Usar conjuntos de texturas"},
    (SENTENCE, "Switch Texture Sets on, which bakes an image for each material of the low object"): {
        "de_DE": "Textursätze einschalten: Jedes Material des Low-Poly-Objekts bekommt ein eigenes Bild",
        "es": "Activa los conjuntos de texturas, que procesan una imagen para cada material del objeto low poly",
    },
    (LABEL, "Make Miss Mask"): {"de_DE": "Maske ohne Treffer erstellen", "es": "Crear máscara de fallos"},
    (OPERATOR, "Cure"): {"de_DE": "Abhilfe", "es": "Remedio"},
    (SENTENCE, "Change what a warning or an error names"): {
        "de_DE": "Ändern, was eine Warnung oder ein Fehler nennt",
        "es": "Cambia lo que nombra una advertencia o un error",
    },
    (LABEL, "Cure"): {"de_DE": "Abhilfe", "es": "Remedio"},
    (SENTENCE, "What to change"): {"de_DE": "Was geändert wird", "es": "Qué cambiar"},
    (LABEL, "Triangulate"): {"de_DE": "Triangulieren", "es": "Triangular"},
    (
        SENTENCE,
        "Add a modifier that divides the faces into the triangles that Blender draws, so that the bake and exporters use the "
        "same ones",
    ): {
        "de_DE": "Einen Modifikator hinzufügen, der die Flächen in die Dreiecke zerlegt, die Blender zeichnet, damit das "
        "Backen und Exporter dieselben verwenden",
        "es": "Adiciona un modificador que divide las caras en los triángulos que Blender dibuja, para que la captura y los "
        "exportadores usen los mismos",
    },
    (LABEL, "Activate UV Map"): {"de_DE": "UV-Map aktivieren", "es": "Activar el mapa UV"},
    (SENTENCE, "Make the UV map of the bake the active one, whose tangents exporters write"): {
        "de_DE": "Die UV-Map des Backens zur aktiven machen, deren Tangenten Exporter schreiben",
        "es": "Hace activo el mapa UV de la captura, cuyas tangentes escriben los exportadores",
    },
    (LABEL, "Smooth inside Islands"): {"de_DE": "In Inseln weich schattieren", "es": "Suavizar dentro de islas"},
    (
        SENTENCE,
        "Make hard edges inside UV islands smooth. Those at borders of islands stay hard, and custom normals stay elsewhere",
    ): {
        "de_DE": "Harte Kanten innerhalb von UV-Inseln weich machen. Die an den Rändern der Inseln bleiben hart, und eigene "
        "Normalen bleiben sonst erhalten",
        "es": "Suaviza los bordes duros dentro de las islas UV. Los de los límites de las islas siguen duros, y las normales "
        "personalizadas se conservan en el resto",
    },
    (LABEL, "Move Mirrored UVs"): {"de_DE": "Gespiegelte UVs verschieben", "es": "Mover UV reflejadas"},
    (
        SENTENCE,
        "Move parts that are mirrored onto others in UV space by one tile: they read the same texels, and the map shows the "
        "detail of the others",
    ): {
        "de_DE": "Teile, die im UV-Raum gespiegelt auf anderen liegen, um eine Kachel verschieben: Sie lesen dieselben Texel, "
        "und die Map zeigt die Details der anderen",
        "es": "Desplaza una celda las partes reflejadas sobre otras en el espacio UV: leen los mismos texels, y el mapa "
        "muestra el detalle de las otras",
    },
}
