# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of the panel Maps: packed images, texture sets, attributes, and maps in materials."""

from ..lookup import LABEL, SENTENCE


def _of_channel(english: str, german: str, spanish: str) -> dict[tuple[str, str], dict[str, str]]:
    """The tooltip of a channel of the packed image."""
    return {
        (SENTENCE, f"What the {english} channel of the packed image stores"): {
            "de_DE": f"Was der {german} des gepackten Bildes speichert",
            "es": f"Qué almacena el canal {spanish} de la imagen empacada",
        }
    }


TABLE = {
    # Packed images
    (LABEL, "Packing and Attributes"): {"de_DE": "Packen und Attribute", "es": "Empaquetado y atributos"},
    (LABEL, "Pack"): {"de_DE": "Packen", "es": "Empacar"},
    (SENTENCE, "Also pack up to four maps into the channels of one image"): {
        "de_DE": "Bis zu vier Maps auch in die Kanäle eines Bildes packen",
        "es": "Empaca además hasta cuatro mapas en los canales de una imagen",
    },
    (SENTENCE, "No packed image"): {"de_DE": "Kein gepacktes Bild", "es": "Sin imagen empacada"},
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
        "es": "Mask Map: metalicidad, oclusión ambiental, máscara de detalle, suavidad",
    },
    (LABEL, "Custom"): {"de_DE": "Benutzerdefiniert", "es": "Personalizado"},
    (SENTENCE, "The channels below"): {"de_DE": "Die Kanäle darunter", "es": "Los canales de abajo"},
    **_of_channel("red", "rote Kanal", "rojo"),
    **_of_channel("green", "grüne Kanal", "verde"),
    **_of_channel("blue", "blaue Kanal", "azul"),
    **_of_channel("alpha", "Alphakanal", "alfa"),
    (LABEL, "Black"): {"de_DE": "Schwarz", "es": "Negro"},
    (SENTENCE, "0 everywhere"): {"de_DE": "Überall 0", "es": "0 en todas partes"},
    (LABEL, "White"): {"de_DE": "Weiß", "es": "Blanco"},
    (SENTENCE, "1 everywhere"): {"de_DE": "Überall 1", "es": "1 en todas partes"},
    (LABEL, "Smoothness"): {"de_DE": "Glätte", "es": "Suavidad"},
    (SENTENCE, "1 - roughness"): {"de_DE": "1 - Rauheit", "es": "1 - rugosidad"},
    # Texture sets, attributes and materials
    (LABEL, "Texture Sets"): {"de_DE": "Textursätze", "es": "Conjuntos de texturas"},
    (
        SENTENCE,
        "Bake an image for each material of the low mesh. {material} in names stands for the material's name",
    ): {
        "de_DE": "Ein Bild für jedes Material des Low-Poly-Meshes backen. {material} in Namen steht für den Namen des "
        "Materials",
        "es": "Captura una imagen por cada material de la malla low poly. {material} en los nombres representa el "
        "nombre del material",
    },
    (SENTENCE, "Texture sets and one image for all low objects exclude each other: choose one of them."): {
        "de_DE": "Textursätze und ein Bild für alle Low-Poly-Objekte schließen einander aus: eines davon wählen.",
        "es": "Los conjuntos de texturas y una imagen para todos los objetos low poly se excluyen entre sí: elegir uno de "
        "ellos.",
    },
    (LABEL, "To Attributes"): {"de_DE": "In Attribute", "es": "En atributos"},
    (SENTENCE, "Also store the maps in attributes of the low mesh"): {
        "de_DE": "Die Maps auch in Attributen des Low-Poly-Meshes speichern",
        "es": "Almacena los mapas también en atributos de la malla low poly",
    },
    (SENTENCE, "Only images"): {"de_DE": "Nur Bilder", "es": "Sólo imágenes"},
    (LABEL, "Face Corners"): {"de_DE": "Flächenecken", "es": "Esquinas de caras"},
    (SENTENCE, "A value for each corner of a face"): {
        "de_DE": "Ein Wert für jede Ecke einer Fläche",
        "es": "Un valor por cada esquina de una cara",
    },
    (LABEL, "Vertices"): {"de_DE": "Eckpunkte", "es": "Vértices"},
    (SENTENCE, "A value for each vertex"): {"de_DE": "Ein Wert für jeden Eckpunkt", "es": "Un valor por cada vértice"},
    (LABEL, "Connect Maps"): {"de_DE": "Maps verbinden", "es": "Conectar mapas"},
    (SENTENCE, "Put the other maps into the low object's material as well"): {
        "de_DE": "Auch die weiteren Maps dem Material des Low-Poly-Objekts hinzufügen",
        "es": "Agrega también los otros mapas al material del objeto low poly",
    },
}
