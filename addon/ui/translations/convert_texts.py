# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of the panel Convert Map."""

from .lookup import LABEL, OPERATOR, SENTENCE


def _axis(channel: str, german: str, spanish: str) -> dict:
    return {
        (SENTENCE, f"Axis of the normal that the {channel} channel of the map to convert stores"): {
            "de_DE": f"Achse der Normale, die der {german} Kanal der umzuwandelnden Map speichert",
            "es": f"Eje de la normal que guarda el canal {spanish} del mapa a convertir",
        }
    }


TABLE = {
    (LABEL, "Convert Map"): {"de_DE": "Map umwandeln", "es": "Convertir mapa"},
    (SENTENCE, "Normal map to convert: an image of Imprint or of another baker"): {
        "de_DE": "Umzuwandelnde Normal-Map: ein Bild von Imprint oder einem anderen Programm",
        "es": "Mapa de normales a convertir: una imagen de Imprint o de otro programa",
    },
    (LABEL, "From Space"): {"de_DE": "Aus Raum", "es": "Desde espacio"},
    (SENTENCE, "Space of the normals in the map to convert"): {
        "de_DE": "Raum der Normalen in der umzuwandelnden Map",
        "es": "Espacio de las normales del mapa a convertir",
    },
    (SENTENCE, "Relative to the low surface"): {
        "de_DE": "Relativ zur Low-Poly-Oberfläche",
        "es": "Relativo a la superficie low poly",
    },
    (SENTENCE, "Relative to the low object"): {
        "de_DE": "Relativ zum Low-Poly-Objekt",
        "es": "Relativo al objeto low poly",
    },
    (SENTENCE, "Relative to the scene, with the low object where it is now"): {
        "de_DE": "Relativ zur Szene, mit dem Low-Poly-Objekt an seinem jetzigen Ort",
        "es": "Relativo a la escena, con el objeto low poly donde está ahora",
    },
    (LABEL, "From Basis"): {"de_DE": "Aus Basis", "es": "Desde base"},
    (SENTENCE, "Tangent basis that the map to convert was made for"): {
        "de_DE": "Tangentenbasis, für die die umzuwandelnde Map gemacht wurde",
        "es": "Base tangente para la que se hizo el mapa a convertir",
    },
    (SENTENCE, "The basis that the scene's render engine uses"): {
        "de_DE": "Die Basis, die die Render-Engine der Szene verwendet",
        "es": "La base que usa el motor de render de la escena",
    },
    (LABEL, "Red Stores"): {"de_DE": "Rot enthält", "es": "Rojo contiene"},
    (LABEL, "Green Stores"): {"de_DE": "Grün enthält", "es": "Verde contiene"},
    (LABEL, "Blue Stores"): {"de_DE": "Blau enthält", "es": "Azul contiene"},
    **_axis("red", "rote", "rojo"),
    **_axis("green", "grüne", "verde"),
    **_axis("blue", "blaue", "azul"),
    (SENTENCE, "No low object: select it, or fill the slot."): {
        "de_DE": "Kein Low-Poly-Objekt: auswählen oder das Feld füllen.",
        "es": "Falta el objeto low poly: seleccionarlo o rellenar el campo.",
    },
    (SENTENCE, "No map to convert: choose an image."): {
        "de_DE": "Keine Map zum Umwandeln: ein Bild wählen.",
        "es": "Falta el mapa a convertir: elegir una imagen.",
    },
    (OPERATOR, "Convert"): {"de_DE": "Umwandeln", "es": "Convertir"},
    (
        SENTENCE,
        "Make a new normal map for the low-poly object of the chosen one, in the space and the basis of the panel Map",
    ): {
        "de_DE": "Aus der gewählten Normal-Map eine neue für das Low-Poly-Objekt machen, im Raum und mit der Basis des Panels "
        "Map",
        "es": "Crea un mapa de normales nuevo para el objeto low poly a partir del elegido, en el espacio y con la base del "
        "panel Mapa",
    },
}
