# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of the settings of the panel Maps that choose, pack, store and connect maps."""

from .lookup import LABEL, SENTENCE

TABLE = {
    (LABEL, "Normal Map"): {"de_DE": "Normalmap", "es": "Mapa de normales"},
    (SENTENCE, "Bake a normal map"): {"de_DE": "Eine Normalmap backen", "es": "Captura un mapa de normales"},
    (LABEL, "Pack"): {"de_DE": "Packen", "es": "Empaquetar"},
    (SENTENCE, "Also pack up to four maps into the channels of one image"): {
        "de_DE": "Zusätzlich bis zu vier Maps in die Kanäle eines Bildes packen",
        "es": "También empaqueta hasta cuatro mapas en los canales de una imagen",
    },
    (LABEL, "None"): {"de_DE": "Keine", "es": "Ninguno"},
    (SENTENCE, "No packed image"): {"de_DE": "Kein gepacktes Bild", "es": "Ninguna imagen empaquetada"},
    (SENTENCE, "Ambient occlusion, roughness, metallic"): {
        "de_DE": "Umgebungsverdeckung, Rauheit, Metallisch",
        "es": "Oclusión ambiental, rugosidad, metalicidad",
    },
    (SENTENCE, "Metallic in red, smoothness in alpha"): {
        "de_DE": "Metallisch in Rot, Glätte in Alpha",
        "es": "Metalicidad en rojo, suavidad en alfa",
    },
    (SENTENCE, "Mask map: metallic, ambient occlusion, detail mask, smoothness"): {
        "de_DE": "Mask Map: Metallisch, Umgebungsverdeckung, Detailmaske, Glätte",
        "es": "Mask map: metalicidad, oclusión ambiental, máscara de detalle, suavidad",
    },
    (LABEL, "Custom"): {"de_DE": "Eigene", "es": "Personalizado"},
    (SENTENCE, "The channels below"): {"de_DE": "Die Kanäle darunter", "es": "Los canales de abajo"},
    (LABEL, "Alpha"): {"de_DE": "Alpha", "es": "Alfa"},
    (SENTENCE, "What the red channel of the packed image stores"): {
        "de_DE": "Inhalt des roten Kanals des gepackten Bildes",
        "es": "Contenido del canal rojo de la imagen empaquetada",
    },
    (SENTENCE, "What the green channel of the packed image stores"): {
        "de_DE": "Inhalt des grünen Kanals des gepackten Bildes",
        "es": "Contenido del canal verde de la imagen empaquetada",
    },
    (SENTENCE, "What the blue channel of the packed image stores"): {
        "de_DE": "Inhalt des blauen Kanals des gepackten Bildes",
        "es": "Contenido del canal azul de la imagen empaquetada",
    },
    (SENTENCE, "What the alpha channel of the packed image stores"): {
        "de_DE": "Inhalt des Alphakanals des gepackten Bildes",
        "es": "Contenido del canal alfa de la imagen empaquetada",
    },
    (LABEL, "Black"): {"de_DE": "Schwarz", "es": "Negro"},
    (SENTENCE, "0 everywhere"): {"de_DE": "Überall 0", "es": "0 en todas partes"},
    (LABEL, "White"): {"de_DE": "Weiß", "es": "Blanco"},
    (SENTENCE, "1 everywhere"): {"de_DE": "Überall 1", "es": "1 en todas partes"},
    (LABEL, "Smoothness"): {"de_DE": "Glätte", "es": "Suavidad"},
    (SENTENCE, "1 - roughness"): {"de_DE": "1 - Rauheit", "es": "1 - rugosidad"},
    (LABEL, "To Attributes"): {"de_DE": "In Attribute", "es": "A atributos"},
    (SENTENCE, "Also store the maps in attributes of the low mesh"): {
        "de_DE": "Die Maps zusätzlich in Attributen des Low-Poly-Meshs speichern",
        "es": "También almacena los mapas en atributos de la malla low poly",
    },
    (SENTENCE, "Only images"): {"de_DE": "Nur Bilder", "es": "Solo imágenes"},
    (LABEL, "Face Corners"): {"de_DE": "Flächenecken", "es": "Esquinas de caras"},
    (SENTENCE, "A value for each corner of a face"): {
        "de_DE": "Ein Wert für jede Ecke einer Fläche",
        "es": "Un valor para cada esquina de una cara",
    },
    (LABEL, "Vertices"): {"de_DE": "Vertices", "es": "Vértices"},
    (SENTENCE, "A value for each vertex"): {
        "de_DE": "Ein Wert für jeden Vertex",
        "es": "Un valor para cada vértice",
    },
    (LABEL, "Connect Maps"): {"de_DE": "Maps verbinden", "es": "Conectar mapas"},
    (SENTENCE, "Put the other maps into the low object's material as well"): {
        "de_DE": "Auch die anderen Maps in das Material des Low-Poly-Objekts einsetzen",
        "es": "Pone también los demás mapas en el material del objeto low poly",
    },
}
