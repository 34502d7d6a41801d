# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of the panel Maps: its groups, the maps that start from rays, and their settings."""

from ..lookup import LABEL, OPERATOR, SENTENCE

TABLE = {
    (LABEL, "Maps"): {"de_DE": "Maps", "es": "Mapas"},
    (LABEL, "Bake Maps"): {"de_DE": "Maps backen", "es": "Capturar mapas"},
    (SENTENCE, "Images of this bake: {}"): {
        "de_DE": "Bilder bei diesem Backen: {}",
        "es": "Imágenes de esta captura: {}",
    },
    (OPERATOR, "Show Map"): {"de_DE": "Map anzeigen", "es": "Mostrar mapa"},
    (SENTENCE, "Show an image of the last bake in an open Image Editor, or else in a new window"): {
        "de_DE": "Ein Bild des letzten Backens in einem offenen Bildeditor anzeigen, sonst in einem neuen Fenster",
        "es": "Muestra una imagen de la última captura en un editor de imágenes abierto o, si no hay, en una "
        "ventana nueva",
    },
    (SENTENCE, "Name of the image; empty for the first one"): {
        "de_DE": "Name des Bildes; leer für das erste",
        "es": "Nombre de la imagen; vacío para la primera",
    },
    (LABEL, "Normal Map"): {"de_DE": "Normalmap", "es": "Mapa de normales"},
    (SENTENCE, "Bake a normal map"): {"de_DE": "Eine Normalmap backen", "es": "Captura un mapa de normales"},
    (LABEL, "High's Normal Maps"): {
        "de_DE": "Normalmaps des High-Poly-Objekts",
        "es": "Mapas de normales del high poly",
    },
    (SENTENCE, "Count the normal and bump maps of the high meshes' materials into the normal map"): {
        "de_DE": "Die Normal- und Bumpmaps der Materialien der High-Poly-Meshes in die Normalmap einrechnen",
        "es": "Incluye en el mapa de normales los mapas de normales y de relieve de los materiales de las mallas "
        "high poly",
    },
    # Groups
    (LABEL, "Occlusion and Curvature"): {"de_DE": "Verdeckung und Krümmung", "es": "Oclusión y curvatura"},
    (LABEL, "Materials and Attributes"): {"de_DE": "Materialien und Attribute", "es": "Materiales y atributos"},
    (LABEL, "Geometry"): {"de_DE": "Geometrie", "es": "Geometría"},
    # Maps
    (LABEL, "Ambient Occlusion"): {"de_DE": "Umgebungsverdeckung", "es": "Oclusión ambiental"},
    (SENTENCE, "The share of the sky that each point of the high surface sees: 1 sees all of it"): {
        "de_DE": "Der Anteil des Himmels, den jeder Punkt der High-Poly-Oberfläche sieht: 1 sieht den ganzen",
        "es": "La parte del cielo que ve cada punto de la superficie high poly: 1 lo ve entero",
    },
    (LABEL, "Bent Normal"): {"de_DE": "Gebeugte Normale", "es": "Normal desviada"},
    (
        SENTENCE,
        "The mean direction from which each point of the high surface sees the sky, in the space and the channels of "
        "the normal map",
    ): {
        "de_DE": "Die mittlere Richtung, in der jeder Punkt der High-Poly-Oberfläche den Himmel sieht, im Raum und in "
        "den Kanälen der Normalmap",
        "es": "La dirección media en la que cada punto de la superficie high poly ve el cielo, en el espacio y los "
        "canales del mapa de normales",
    },
    (LABEL, "Thickness"): {"de_DE": "Dicke", "es": "Grosor"},
    (
        SENTENCE,
        "The mean length of rays into the high surface, up to the thickness distance: black is thin, white is thick",
    ): {
        "de_DE": "Die mittlere Länge der Strahlen in die High-Poly-Oberfläche hinein, höchstens der Dickenabstand: "
        "Schwarz ist dünn, Weiß ist dick",
        "es": "La longitud media de los rayos hacia el interior de la superficie high poly, hasta la distancia de "
        "grosor: negro es fino, blanco es grueso",
    },
    (LABEL, "Curvature"): {"de_DE": "Krümmung", "es": "Curvatura"},
    (
        SENTENCE,
        "The share of a ball around each point that is outside the high surface: gray is flat, white an edge of 90 "
        "degrees, black a groove of 90 degrees",
    ): {
        "de_DE": "Der Anteil einer Kugel um jeden Punkt, der außerhalb der High-Poly-Oberfläche liegt: Grau ist flach, "
        "Weiß eine Kante von 90 Grad, Schwarz eine Rille von 90 Grad",
        "es": "La parte de una esfera alrededor de cada punto que queda fuera de la superficie high poly: gris es "
        "plano, blanco un borde de 90 grados, negro un surco de 90 grados",
    },
    (LABEL, "Convexity"): {"de_DE": "Konvexität", "es": "Convexidad"},
    (SENTENCE, "The edges of the curvature map: black is flat, white an edge of 90 degrees"): {
        "de_DE": "Die Kanten der Krümmungsmap: Schwarz ist flach, Weiß eine Kante von 90 Grad",
        "es": "Los bordes del mapa de curvatura: negro es plano, blanco un borde de 90 grados",
    },
    (LABEL, "Cavity"): {"de_DE": "Vertiefungen", "es": "Cavidad"},
    (SENTENCE, "The grooves of the curvature map: black is flat, white a groove of 90 degrees"): {
        "de_DE": "Die Rillen der Krümmungsmap: Schwarz ist flach, Weiß eine Rille von 90 Grad",
        "es": "Los surcos del mapa de curvatura: negro es plano, blanco un surco de 90 grados",
    },
    # Settings
    (
        SENTENCE,
        "Rays per texel for ambient occlusion, bent normals, thickness and curvature. 128 leave an error of about 2 of "
        "255 steps, 4 times as many half of it",
    ): {
        "de_DE": "Strahlen pro Texel für Umgebungsverdeckung, gebeugte Normalen, Dicke und Krümmung. 128 lassen einen "
        "Fehler von etwa 2 von 255 Stufen, 4-mal so viele die Hälfte davon",
        "es": "Rayos por texel para la oclusión ambiental, las normales desviadas, el grosor y la curvatura. 128 dejan "
        "un error de unos 2 de 255 pasos; 4 veces más, la mitad",
    },
    (LABEL, "Distance Unit"): {"de_DE": "Abstandseinheit", "es": "Unidad de distancia"},
    (SENTENCE, "Unit of the AO distance, the thickness distance and the curvature radius"): {
        "de_DE": "Einheit des AO-Abstands, des Dickenabstands und des Krümmungsradius",
        "es": "Unidad de la distancia de AO, de la distancia de grosor y del radio de curvatura",
    },
    (LABEL, "Diagonal"): {"de_DE": "Diagonale", "es": "Diagonal"},
    (SENTENCE, "A share of the diagonal of the high meshes' bounding box"): {
        "de_DE": "Ein Anteil der Diagonale des Hüllquaders der High-Poly-Meshes",
        "es": "Una parte de la diagonal del marco de las mallas high poly",
    },
    (LABEL, "Scene Units"): {"de_DE": "Szeneneinheiten", "es": "Unidades de la escena"},
    (SENTENCE, "Scene units"): {"de_DE": "Einheiten der Szene", "es": "Unidades de la escena"},
    (LABEL, "Set Distance"): {"de_DE": "Abstand setzen", "es": "Definir distancia"},
    (SENTENCE, "Limit the distance of occluders"): {
        "de_DE": "Den Abstand verdeckender Flächen begrenzen",
        "es": "Limita la distancia de las superficies que ocluyen",
    },
    (LABEL, "AO Distance"): {"de_DE": "AO-Abstand", "es": "Distancia de AO"},
    (SENTENCE, "Distance beyond which the high surface does not block rays"): {
        "de_DE": "Abstand, jenseits dessen die High-Poly-Oberfläche keine Strahlen abhält",
        "es": "Distancia más allá de la cual la superficie high poly no bloquea rayos",
    },
    (LABEL, "AO Fade"): {"de_DE": "AO-Abnahme", "es": "Atenuación de AO"},
    (SENTENCE, "How occlusion fades up to the AO distance. Without a distance, it does not fade"): {
        "de_DE": "Wie die Verdeckung bis zum AO-Abstand abnimmt. Ohne Abstand nimmt sie nicht ab",
        "es": "Cómo se atenúa la oclusión hasta la distancia de AO. Sin distancia, no se atenúa",
    },
    (LABEL, "None"): {"de_DE": "Keine", "es": "Ninguno"},
    (SENTENCE, "Full occlusion up to the distance"): {
        "de_DE": "Volle Verdeckung bis zum Abstand",
        "es": "Oclusión total hasta la distancia",
    },
    (LABEL, "Linear"): {"de_DE": "Linear", "es": "Lineal"},
    (SENTENCE, "Occlusion fades evenly"): {
        "de_DE": "Die Verdeckung nimmt gleichmäßig ab",
        "es": "La oclusión se atenúa de manera uniforme",
    },
    (SENTENCE, "Occlusion fades slowly at both ends"): {
        "de_DE": "Die Verdeckung nimmt an beiden Enden langsam ab",
        "es": "La oclusión se atenúa lentamente en ambos extremos",
    },
    (LABEL, "Occluders"): {"de_DE": "Verdeckende Objekte", "es": "Objetos que ocluyen"},
    (SENTENCE, "High objects that block rays"): {
        "de_DE": "High-Poly-Objekte, die Strahlen abhalten",
        "es": "Objetos high poly que bloquean rayos",
    },
    (SENTENCE, "The high objects of the same low object"): {
        "de_DE": "Die High-Poly-Objekte desselben Low-Poly-Objekts",
        "es": "Los objetos high poly del mismo objeto low poly",
    },
    (LABEL, "All"): {"de_DE": "Alle", "es": "Todos"},
    (SENTENCE, "The high objects of all pairs that are baked together"): {
        "de_DE": "Die High-Poly-Objekte aller Paare, die zusammen gebacken werden",
        "es": "Los objetos high poly de todas las parejas que se capturan juntas",
    },
    (LABEL, "Floor"): {"de_DE": "Boden", "es": "Piso"},
    (SENTENCE, "Let a floor under the lowest point of the high meshes block rays"): {
        "de_DE": "Einen Boden unter dem tiefsten Punkt der High-Poly-Meshes Strahlen abhalten lassen",
        "es": "Hace que un piso bajo el punto más bajo de las mallas high poly bloquee rayos",
    },
    (LABEL, "Two-Sided"): {"de_DE": "Beidseitig", "es": "Ambos lados"},
    (SENTENCE, "Let back faces block rays too. Use it for open meshes, such as leaves and cloth"): {
        "de_DE": "Auch Rückseiten Strahlen abhalten lassen. Für offene Meshes wie Blätter und Stoff",
        "es": "Hace que las caras posteriores también bloqueen rayos. Para mallas abiertas, como hojas y telas",
    },
    (LABEL, "Bias Angle"): {"de_DE": "Versatzwinkel", "es": "Ángulo de desvío"},
    (
        SENTENCE,
        "Degrees above the horizon in which ambient occlusion casts no rays. It hides the facets of a coarse high mesh",
    ): {
        "de_DE": "Grad über dem Horizont, in denen die Umgebungsverdeckung keine Strahlen wirft. Das verbirgt die "
        "Facetten eines groben High-Poly-Meshes",
        "es": "Grados sobre el horizonte en los que la oclusión ambiental no proyecta rayos. Oculta las facetas de una "
        "malla high poly tosca",
    },
    (LABEL, "Set Thickness"): {"de_DE": "Dicke setzen", "es": "Definir grosor"},
    (SENTENCE, "Set the thickness distance"): {
        "de_DE": "Den Dickenabstand einstellen",
        "es": "Define la distancia de grosor",
    },
    (LABEL, "Thickness Distance"): {"de_DE": "Dickenabstand", "es": "Distancia de grosor"},
    (SENTENCE, "Length of a ray that stores white in the thickness map"): {
        "de_DE": "Länge eines Strahls, die in der Dickenmap Weiß ergibt",
        "es": "Longitud de un rayo que almacena blanco en el mapa de grosor",
    },
    (LABEL, "Set Radius"): {"de_DE": "Radius setzen", "es": "Definir radio"},
    (SENTENCE, "Set the curvature radius"): {
        "de_DE": "Den Krümmungsradius einstellen",
        "es": "Define el radio de curvatura",
    },
    (LABEL, "Radius"): {"de_DE": "Radius", "es": "Radio"},
    (LABEL, "Curvature Radius"): {"de_DE": "Krümmungsradius", "es": "Radio de curvatura"},
    (
        SENTENCE,
        "Radius of the ball in which curvature is measured. Small radii find fine edges, large ones find shapes",
    ): {
        "de_DE": "Radius der Kugel, in der die Krümmung gemessen wird. Kleine Radien finden feine Kanten, große finden "
        "Formen",
        "es": "Radio de la esfera en la que se mide la curvatura. Los radios pequeños encuentran bordes finos, los "
        "grandes encuentran formas",
    },
    # Steps of a bake
    (LABEL, "Casting rays for occlusion"): {
        "de_DE": "Strahlen für die Verdeckung werden geworfen",
        "es": "Proyectando rayos para la oclusión",
    },
    (LABEL, "Casting rays for thickness"): {
        "de_DE": "Strahlen für die Dicke werden geworfen",
        "es": "Proyectando rayos para el grosor",
    },
    (LABEL, "Casting rays for curvature"): {
        "de_DE": "Strahlen für die Krümmung werden geworfen",
        "es": "Proyectando rayos para la curvatura",
    },
    (LABEL, "Reading the images of the high meshes"): {
        "de_DE": "Bilder der High-Poly-Meshes werden gelesen",
        "es": "Leyendo las imágenes de las mallas high poly",
    },
    (LABEL, "Reading the surface"): {"de_DE": "Oberfläche wird gelesen", "es": "Leyendo la superficie"},
}
