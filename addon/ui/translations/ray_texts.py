# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of the panel Rays."""

from .lookup import LABEL, OPERATOR, SENTENCE

TABLE = {
    (LABEL, "Rays"): {"de_DE": "Strahlen", "es": "Rayos"},
    (LABEL, "Cage"): {"de_DE": "Käfig", "es": "Jaula"},
    (SENTENCE, "Mesh on which the rays start. It must have the topology of the low mesh"): {
        "de_DE": "Mesh, auf dem die Strahlen beginnen. Es muss die Topologie des Low-Poly-Meshes haben",
        "es": "Malla desde la que parten los rayos. Debe tener la topología de la malla low poly",
    },
    (LABEL, "Measure Distances"): {"de_DE": "Abstände messen", "es": "Medir distancias"},
    (SENTENCE, "Measure how far the high surface lies from the low one, instead of using the distances below"): {
        "de_DE": "Messen, wie weit die High-Poly-Oberfläche von der Low-Poly-Oberfläche entfernt ist, statt die "
        "Abstände unten zu verwenden",
        "es": "Mide a qué distancia está la superficie high poly de la low poly, en vez de usar las distancias "
        "de abajo",
    },
    (LABEL, "Extrusion"): {"de_DE": "Extrusion", "es": "Extrusión"},
    (SENTENCE, "Distance outside the low mesh at which the rays start"): {
        "de_DE": "Abstand außerhalb des Low-Poly-Meshes, in dem die Strahlen beginnen",
        "es": "Distancia por fuera de la malla low poly a la que parten los rayos",
    },
    (LABEL, "Max Distance"): {"de_DE": "Max. Abstand", "es": "Distancia máx"},
    (SENTENCE, "Length of the rays, from where they start"): {
        "de_DE": "Länge der Strahlen, von ihrem Anfang aus",
        "es": "Longitud de los rayos, desde su origen",
    },
    (SENTENCE, "Distance that the last bake measured"): {
        "de_DE": "Abstand, den der letzte Backvorgang gemessen hat",
        "es": "Distancia que midió la última captura",
    },
    (OPERATOR, "Freeze Distances"): {"de_DE": "Abstände fixieren", "es": "Fijar distancias"},
    (SENTENCE, "Set Extrusion and Max Distance to what the last bake of this low object measured"): {
        "de_DE": "Extrusion und Max. Abstand auf die Werte setzen, die der letzte Backvorgang dieses "
        "Low-Poly-Objekts gemessen hat",
        "es": "Asigna a Extrusión y Distancia máx los valores que midió la última captura de este objeto low poly",
    },
    (SENTENCE, "Bake this low object first, with Measure Distances on"): {
        "de_DE": "Zuerst dieses Low-Poly-Objekt mit Abstände messen backen",
        "es": "Capturar antes este objeto low poly, con Medir distancias activado",
    },
    (OPERATOR, "Show Cage"): {"de_DE": "Käfig anzeigen", "es": "Mostrar jaula"},
    (SENTENCE, "Show or hide two shells around the low mesh: where rays start (blue) and where they end (orange)"): {
        "de_DE": "Zwei Hüllen um das Low-Poly-Mesh anzeigen oder verbergen: wo Strahlen beginnen (blau) und wo sie "
        "enden (orange)",
        "es": "Muestra u oculta dos envolturas alrededor de la malla low poly: donde parten los rayos (azul) y "
        "donde terminan (naranja)",
    },
    (LABEL, "Hit"): {"de_DE": "Treffer", "es": "Impacto"},
    (SENTENCE, "Which of the high surfaces along a ray the map shows"): {
        "de_DE": "Welche der High-Poly-Oberflächen entlang eines Strahls die Textur zeigt",
        "es": "Cuál de las superficies high poly a lo largo de un rayo muestra el mapa",
    },
    (LABEL, "Own"): {"de_DE": "Eigener", "es": "Propio"},
    (
        SENTENCE,
        "The outermost surface that belongs to the texel: the texel is at the closest point of the low mesh, or next to it. "
        "Rays pass through other layers",
    ): {
        "de_DE": "Die äußerste Oberfläche, die zum Texel gehört: das Texel liegt am nächsten Punkt des Low-Poly-Meshes oder "
        "daneben. Strahlen gehen durch andere Schichten hindurch",
        "es": "La superficie más exterior que pertenece al téxel: el téxel está en el punto más cercano de la malla low poly, "
        "o a su lado. Los rayos atraviesan otras capas",
    },
    (LABEL, "Outermost"): {"de_DE": "Äußerster", "es": "Más exterior"},
    (SENTENCE, "The first surface from outside"): {
        "de_DE": "Die erste Oberfläche von außen",
        "es": "La primera superficie desde fuera",
    },
    (LABEL, "Nearest"): {"de_DE": "Nächster", "es": "Más cercano"},
    (SENTENCE, "The surface nearest to the low mesh, inside or outside"): {
        "de_DE": "Die Oberfläche, die dem Low-Poly-Mesh am nächsten ist, innen oder außen",
        "es": "La superficie más cercana a la malla low poly, dentro o fuera",
    },
    (LABEL, "Directions"): {"de_DE": "Richtungen", "es": "Direcciones"},
    (SENTENCE, "Normals of the low mesh that the rays follow"): {
        "de_DE": "Normalen des Low-Poly-Meshes, denen die Strahlen folgen",
        "es": "Normales de la malla low poly que siguen los rayos",
    },
    (LABEL, "Blended"): {"de_DE": "Überblendet", "es": "Fundidas"},
    (SENTENCE, "Smooth at hard edges, which leaves no gaps, and straight away from them, which skews nothing"): {
        "de_DE": "Weich an harten Kanten, was keine Lücken hinterlässt, und gerade abseits von ihnen, was nichts verzerrt",
        "es": "Suaves en los bordes duros, lo que no deja huecos, y rectas lejos de ellos, lo que no sesga nada",
    },
    (LABEL, "Smooth"): {"de_DE": "Weich", "es": "Suavizar"},
    (SENTENCE, "Smooth vertex normals. Hard edges leave no gaps"): {
        "de_DE": "Weiche Eckpunktnormalen. Harte Kanten hinterlassen keine Lücken",
        "es": "Normales de vértices suaves. Los bordes duros no dejan huecos",
    },
    (LABEL, "Split"): {"de_DE": "Geteilt", "es": "Dividir"},
    (SENTENCE, "The mesh's own normals, with hard edges and custom normals"): {
        "de_DE": "Die eigenen Normalen des Meshes, mit harten Kanten und benutzerdefinierten Normalen",
        "es": "Las normales propias de la malla, con bordes duros y normales personalizadas",
    },
    (LABEL, "Offset Group"): {"de_DE": "Versatzgruppe", "es": "Grupo de desplazamiento"},
    (
        SENTENCE,
        "Vertex group of the low mesh that scales the extrusion: with a weight of 0 rays start on the surface, 0.5 changes "
        "nothing, and with 1 they start twice as far out. Leave empty to use the same extrusion everywhere",
    ): {
        "de_DE": "Eckpunktgruppe des Low-Poly-Meshes, die die Extrusion skaliert: mit dem Gewicht 0 beginnen Strahlen auf "
        "der Oberfläche, 0,5 ändert nichts, und mit 1 beginnen sie doppelt so weit außen. Leer lassen für überall dieselbe "
        "Extrusion",
        "es": "Grupo de vértices de la malla low poly que escala la extrusión: con influencia 0 los rayos parten de la "
        "superficie, 0,5 no cambia nada y con 1 parten al doble de distancia. Dejar vacío para usar la misma extrusión "
        "en todas partes",
    },
    (LABEL, "Straight Group"): {"de_DE": "Geradegruppe", "es": "Grupo de rayos rectos"},
    (
        SENTENCE,
        "Vertex group of the low mesh that turns the rays: with a weight of 0 they follow smooth normals, 0.5 changes "
        "nothing, and with 1 they follow the mesh's own normals. Leave empty to use the chosen directions everywhere",
    ): {
        "de_DE": "Eckpunktgruppe des Low-Poly-Meshes, die die Strahlen dreht: mit dem Gewicht 0 folgen sie weichen Normalen, "
        "0,5 ändert nichts, und mit 1 folgen sie den eigenen Normalen des Meshes. Leer lassen für überall die gewählten "
        "Richtungen",
        "es": "Grupo de vértices de la malla low poly que gira los rayos: con influencia 0 siguen normales suaves, 0,5 no "
        "cambia nada y con 1 siguen las normales propias de la malla. Dejar vacío para usar las direcciones elegidas en "
        "todas partes",
    },
    (OPERATOR, "Propose Weights"): {"de_DE": "Gewichte vorschlagen", "es": "Proponer influencias"},
    (
        SENTENCE,
        "Fill both groups with weights that leave fewer doubtful texels than the last bake had, and with 0.5 elsewhere",
    ): {
        "de_DE": "Beide Gruppen mit Gewichten füllen, mit denen weniger Texel zweifelhaft sind als beim letzten "
        "Backvorgang, und sonst mit 0,5",
        "es": "Llena ambos grupos con influencias que dejan menos texels dudosos que la última captura, y con 0,5 en el "
        "resto",
    },
    (SENTENCE, "Bake this low object first"): {
        "de_DE": "Zuerst dieses Low-Poly-Objekt backen",
        "es": "Capturar antes este objeto low poly",
    },
    (SENTENCE, "The last bake cast no rays"): {
        "de_DE": "Der letzte Backvorgang hat keine Strahlen verwendet",
        "es": "La última captura no usó rayos",
    },
    (SENTENCE, "Leave Edit Mode first"): {
        "de_DE": "Zuerst den Bearbeitungsmodus verlassen",
        "es": "Salir antes del modo Edición",
    },
    (SENTENCE, "The low object is linked from another file"): {
        "de_DE": "Das Low-Poly-Objekt ist aus einer anderen Datei verknüpft",
        "es": "El objeto low poly está vinculado desde otro archivo",
    },
    (LABEL, "Ignore Backfaces"): {"de_DE": "Ohne Rückseiten", "es": "Sin caras traseras"},
    (SENTENCE, "Let the rays pass through faces of the high mesh that point away from them"): {
        "de_DE": "Strahlen durch Flächen des High-Poly-Meshes hindurchlassen, die von ihnen abgewandt sind",
        "es": "Deja que los rayos atraviesen las caras de la malla high poly orientadas en sentido contrario a ellos",
    },
    (LABEL, "Miss Color"): {"de_DE": "Ohne Treffer", "es": "Color de fallo"},
    (SENTENCE, "Color of texels whose ray hits nothing. Their alpha is 0"): {
        "de_DE": "Farbe von Texeln, deren Strahl nichts trifft. Ihr Alpha ist 0",
        "es": "Color de los texels cuyo rayo no alcanza nada. Su alfa es 0",
    },
    (LABEL, "Miss Mask"): {"de_DE": "Maske ohne Treffer", "es": "Máscara de fallos"},
    (SENTENCE, "Also make an image that is white where the rays hit nothing"): {
        "de_DE": "Zusätzlich ein Bild erzeugen, das dort weiß ist, wo Strahlen nichts treffen",
        "es": "Crea además una imagen que es blanca donde los rayos no alcanzan nada",
    },
}
