# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of the panels Pairs by Name and Sequence."""

from .lookup import LABEL, OPERATOR, SENTENCE

TABLE = {
    (LABEL, "Pairs by Name"): {"de_DE": "Paare nach Namen", "es": "Pares por nombre"},
    (SENTENCE, "Ending of the names of low objects, in any case"): {
        "de_DE": "Namensendung der Low-Poly-Objekte, in beliebiger Groß-/Kleinschreibung",
        "es": "Final de los nombres de los objetos low poly, en mayúsculas o minúsculas",
    },
    (SENTENCE, "Ending of the names of high objects, in any case. An underscore and more may follow it"): {
        "de_DE": "Namensendung der High-Poly-Objekte, in beliebiger Groß-/Kleinschreibung. Danach kann ein "
        "Unterstrich mit weiterem Text folgen",
        "es": "Final de los nombres de los objetos high poly, en mayúsculas o minúsculas. Puede seguirle un "
        "guión bajo con más texto",
    },
    (SENTENCE, "Ending of the names of cages, in any case"): {
        "de_DE": "Namensendung der Käfige, in beliebiger Groß-/Kleinschreibung",
        "es": "Final de los nombres de las jaulas, en mayúsculas o minúsculas",
    },
    (SENTENCE, "No object name ends with one of these suffixes."): {
        "de_DE": "Kein Objektname endet auf eines dieser Suffixe.",
        "es": "Ningún nombre de objeto termina con uno de estos sufijos.",
    },
    (LABEL, "One Image"): {"de_DE": "Ein Bild", "es": "Una imagen"},
    (SENTENCE, "Bake all pairs into one image, an atlas"): {
        "de_DE": "Alle Paare in ein einziges Bild backen, einen Atlas",
        "es": "Captura todos los pares en una sola imagen, un atlas",
    },
    (OPERATOR, "Bake Pairs by Name"): {"de_DE": "Paare nach Namen backen", "es": "Capturar pares por nombre"},
    (SENTENCE, "Bake each low object of the scene against the high objects with a matching name"): {
        "de_DE": "Jedes Low-Poly-Objekt der Szene mit den High-Poly-Objekten passenden Namens backen",
        "es": "Captura cada objeto low poly de la escena con los objetos high poly de nombre correspondiente",
    },
    (LABEL, "Sequence"): {"de_DE": "Sequenz", "es": "Secuencia"},
    (LABEL, "First"): {"de_DE": "Erstes", "es": "Primero"},
    (LABEL, "Last"): {"de_DE": "Letztes", "es": "Último"},
    (SENTENCE, "First frame; below 0 for that of the scene"): {
        "de_DE": "Erstes Einzelbild; unter 0 für das der Szene",
        "es": "Primer fotograma; menor que 0 para el de la escena",
    },
    (SENTENCE, "Last frame; below 0 for that of the scene"): {
        "de_DE": "Letztes Einzelbild; unter 0 für das der Szene",
        "es": "Último fotograma; menor que 0 para el de la escena",
    },
    (OPERATOR, "Bake Sequence"): {"de_DE": "Sequenz backen", "es": "Capturar secuencia"},
    (SENTENCE, "Bake each frame of the scene's range into a numbered file, for example for wrinkle maps"): {
        "de_DE": "Jedes Einzelbild des Bildbereichs der Szene in eine nummerierte Datei backen, zum Beispiel für "
        "Falten-Maps",
        "es": "Captura cada fotograma del rango de la escena en un archivo numerado, por ejemplo para mapas de arrugas",
    },
    (SENTENCE, "Set Store to File to bake a sequence."): {
        "de_DE": "Für eine Sequenz muss Speichern auf Datei stehen.",
        "es": "Para capturar una secuencia, elegir Archivo en Guardar.",
    },
}
