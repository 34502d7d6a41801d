# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages of a bake that panels show: its steps, and errors that name no object."""

from .lookup import LABEL, SENTENCE

TABLE = {
    (LABEL, "Starting"): {"de_DE": "Starten", "es": "Iniciando"},
    (LABEL, "Building the tree"): {"de_DE": "Baum aufbauen", "es": "Construyendo el árbol"},
    (LABEL, "Measuring distances"): {"de_DE": "Abstände messen", "es": "Midiendo distancias"},
    (LABEL, "Drawing"): {"de_DE": "Zeichnen", "es": "Dibujando"},
    (LABEL, "Storing"): {"de_DE": "Speichern", "es": "Guardando"},
    (SENTENCE, "{} min left"): {"de_DE": "noch {} min", "es": "faltan {} min"},
    (SENTENCE, "{} s left"): {"de_DE": "noch {} s", "es": "faltan {} s"},
    (SENTENCE, "Esc: stop"): {"de_DE": "Esc: anhalten", "es": "Esc: detener"},
    (SENTENCE, "No low object: select the high objects, then the low one, or fill the slots."): {
        "de_DE": "Kein Low-Poly-Objekt: zuerst die High-Poly-Objekte, dann das Low-Poly-Objekt auswählen oder die "
        "Einträge füllen.",
        "es": "Falta el objeto low poly: seleccionar los objetos high poly y luego el low poly, o llenar las entradas.",
    },
    (SENTENCE, "Tiles are set but UDIM Tiles is off: enable it."): {
        "de_DE": "Kacheln sind angegeben, aber UDIM-Kacheln ist aus: einschalten.",
        "es": "Hay celdas definidas pero Celdas UDIM está desactivado: activarlo.",
    },
    (SENTENCE, "Blender cannot keep UDIM tiles in memory alone: store them in a file, or packed."): {
        "de_DE": "Blender kann UDIM-Kacheln nicht nur im Arbeitsspeicher halten: in einer Datei oder gepackt "
        "speichern.",
        "es": "Blender no puede mantener celdas UDIM sólo en la memoria: guardarlas en un archivo o empacadas.",
    },
    (SENTENCE, "No file is set for the map: set one, or store the map packed."): {
        "de_DE": "Für die Map ist keine Datei angegeben: eine angeben oder die Map gepackt speichern.",
        "es": "No hay un archivo definido para el mapa: definir uno o guardar el mapa empacado.",
    },
    (SENTENCE, "The suffixes of low, high and cage objects must all be different, and none may be empty."): {
        "de_DE": "Die Suffixe von Low-Poly-Objekten, High-Poly-Objekten und Käfigen müssen verschieden sein, und "
        "keines darf leer sein.",
        "es": "Los sufijos de los objetos low poly, high poly y jaulas deben ser todos distintos, y ninguno "
        "puede estar vacío.",
    },
    (SENTENCE, "Live draws one image for all materials: turn Texture Sets off."): {
        "de_DE": "Live zeichnet ein Bild für alle Materialien: Textursätze ausschalten.",
        "es": "En vivo dibuja una sola imagen para todos los materiales: desactivar Conjuntos de texturas.",
    },
    (SENTENCE, "Live draws only one tile: turn UDIM Tiles off."): {
        "de_DE": "Live zeichnet nur eine Kachel: UDIM-Kacheln ausschalten.",
        "es": "En vivo dibuja una sola celda: desactivar Celdas UDIM.",
    },
    (SENTENCE, "A sequence needs files: set Store to File."): {
        "de_DE": "Eine Sequenz braucht Dateien: Speichern auf Datei stellen.",
        "es": "Una secuencia necesita archivos: elegir Archivo en Guardar.",
    },
    (SENTENCE, "A sequence shows the normal map: switch Normal Map on."): {
        "de_DE": "Eine Sequenz zeigt die Normalmap: Normalmap einschalten.",
        "es": "Una secuencia muestra el mapa de normales: activar Mapa de normales.",
    },
    (SENTENCE, "No map is chosen: choose the normal map, another map, or maps to pack."): {
        "de_DE": "Es ist keine Map gewählt: die Normalmap, eine andere Map oder Maps zum Packen wählen.",
        "es": "No hay ningún mapa elegido: elegir el mapa de normales, otro mapa o mapas para empaquetar.",
    },
    (SENTENCE, "The packed image would hold no map: choose a map for one of its channels."): {
        "de_DE": "Das gepackte Bild enthielte keine Map: für einen seiner Kanäle eine Map wählen.",
        "es": "La imagen empaquetada no contendría ningún mapa: elegir un mapa para uno de sus canales.",
    },
    (SENTENCE, "A sequence has only one tile: turn UDIM Tiles off."): {
        "de_DE": "Eine Sequenz hat nur eine Kachel: UDIM-Kacheln ausschalten.",
        "es": "Una secuencia tiene una sola celda: desactivar Celdas UDIM.",
    },
    (SENTENCE, "A sequence has one image for all materials: turn Texture Sets off."): {
        "de_DE": "Eine Sequenz hat ein Bild für alle Materialien: Textursätze ausschalten.",
        "es": "Una secuencia tiene una imagen para todos los materiales: desactivar Conjuntos de texturas.",
    },
    (SENTENCE, "A sequence cannot have frames below 0: Blender would not find their files."): {
        "de_DE": "Eine Sequenz kann keine Einzelbilder unter 0 haben: Blender würde ihre Dateien nicht finden.",
        "es": "Una secuencia no puede tener fotogramas menores que 0: Blender no encontraría sus archivos.",
    },
    (SENTENCE, "There is no frame to bake: set the end frame to the start frame or later."): {
        "de_DE": "Es gibt kein Einzelbild zu backen: das Endbild auf das Startbild oder später setzen.",
        "es": "No hay fotogramas que capturar: poner el fotograma final en el inicial o después.",
    },
    (SENTENCE, "The scene of the sequence was deleted: bring it back with Undo, or choose another one."): {
        "de_DE": "Die Szene der Sequenz wurde gelöscht: mit Rückgängig wiederherstellen oder eine andere wählen.",
        "es": "La escena de la secuencia fue eliminada: recuperarla con Deshacer o elegir otra.",
    },
}
