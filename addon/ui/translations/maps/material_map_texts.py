# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of the panel Maps: the maps of materials and attributes."""

from ..lookup import LABEL, SENTENCE


def _of_materials(english: str, german: str, spanish: str) -> dict[tuple[str, str], dict[str, str]]:
    """The label and the tooltip of the map of a socket."""
    return {
        (LABEL, english): {"de_DE": german, "es": spanish},
        (SENTENCE, f"{english} of the high meshes' materials"): {
            "de_DE": f"{german} der Materialien der High-Poly-Meshes",
            "es": f"{spanish} de los materiales de las mallas high poly",
        },
    }


TABLE = {
    **_of_materials("Base Color", "Grundfarbe", "Color base"),
    **_of_materials("Roughness", "Rauheit", "Rugosidad"),
    (LABEL, "Widened Roughness"): {"de_DE": "Verbreiterte Rauheit", "es": "Rugosidad ensanchada"},
    (
        SENTENCE,
        "Roughness of the high meshes' materials, widened by the detail that is finer than a texel",
    ): {
        "de_DE": "Rauheit der Materialien der High-Poly-Meshes, verbreitert um die Details, die feiner als ein Texel sind",
        "es": "Rugosidad de los materiales de las mallas high poly, ensanchada por el detalle más fino que un téxel",
    },
    **_of_materials("Metallic", "Metallisch", "Metalicidad"),
    **_of_materials("Emission", "Emission", "Emisión"),
    **_of_materials("Alpha", "Alpha", "Alfa"),
    **_of_materials("Specular", "Glanz", "Especular"),
    **_of_materials("Transmission", "Transmission", "Transmisión"),
    **_of_materials("Coat", "Beschichtung", "Barniz"),
    **_of_materials("Sheen", "Samtglanz", "Afelpado"),
    **_of_materials("Subsurface", "Volumenstreuung", "Transluminiscencia"),
    (LABEL, "Attribute"): {"de_DE": "Attribut", "es": "Atributo"},
    (SENTENCE, "An attribute of the high meshes, such as vertex colors"): {
        "de_DE": "Ein Attribut der High-Poly-Meshes, etwa Farben an Eckpunkten",
        "es": "Un atributo de las mallas high poly, como los colores de vértices",
    },
    (
        SENTENCE,
        "Name of the attribute of the high meshes for the attribute map. Leave empty to use the color attribute that "
        "is set to render",
    ): {
        "de_DE": "Name des Attributs der High-Poly-Meshes für die Attributmap. Leer lassen, um das Farbattribut für das "
        "Rendern zu verwenden",
        "es": "Nombre del atributo de las mallas high poly para el mapa de atributo. Dejar vacío para usar el atributo "
        "de color para procesar",
    },
    (SENTENCE, "An image of the high meshes was removed during the bake: bake again."): {
        "de_DE": "Ein Bild der High-Poly-Meshes wurde während des Backens entfernt: erneut backen.",
        "es": "Una imagen de las mallas high poly se eliminó durante la captura: capturar de nuevo.",
    },
}
