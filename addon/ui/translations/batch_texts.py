# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of the panels Pairs by Name, Sequence and Levels of Detail."""

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
    (LABEL, "Flamenco Manager"): {"de_DE": "Flamenco-Manager", "es": "Gestor de Flamenco"},
    (SENTENCE, "Address of the Flamenco Manager that gets job files, as http://flamenco.local:8080"): {
        "de_DE": "Adresse des Flamenco-Managers, der Auftragsdateien bekommt, etwa http://flamenco.local:8080",
        "es": "Dirección del gestor de Flamenco que recibe archivos de trabajos, como http://flamenco.local:8080",
    },
    (OPERATOR, "Send to Flamenco"): {"de_DE": "An Flamenco senden", "es": "Enviar a Flamenco"},
    (
        SENTENCE,
        "Send a job file to the Flamenco Manager in the add-on's preferences. All its machines must see the file",
    ): {
        "de_DE": "Eine Auftragsdatei an den Flamenco-Manager in den Einstellungen des Add-ons senden. Alle seine Rechner "
        "müssen die Datei sehen",
        "es": "Envía un archivo de trabajos al gestor de Flamenco de las preferencias de la extensión. Todas sus máquinas "
        "deben ver el archivo",
    },
    (LABEL, "Job File"): {"de_DE": "Auftragsdatei", "es": "Archivo de trabajos"},
    (SENTENCE, "Job file with the bakes, .toml or .json"): {
        "de_DE": "Auftragsdatei mit den Maps, .toml oder .json",
        "es": "Archivo de trabajos con las capturas, .toml o .json",
    },
    (LABEL, "Parts"): {"de_DE": "Teile", "es": "Partes"},
    (SENTENCE, "Number of parts of about the same cost, each a task"): {
        "de_DE": "Anzahl der Teile mit etwa gleichem Aufwand, jeder eine Aufgabe",
        "es": "Número de partes de coste parecido, cada una una tarea",
    },
    (SENTENCE, "Allow online access in Blender's preferences first"): {
        "de_DE": "Zuerst den Online-Zugriff in den Einstellungen von Blender erlauben",
        "es": "Primero permitir el acceso en línea en las preferencias de Blender",
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
    (LABEL, "Levels of Detail"): {"de_DE": "Detailstufen", "es": "Niveles de detalle"},
    (LABEL, "Degrees"): {"de_DE": "Grad", "es": "Grados"},
    (LABEL, "Distance (%)"): {"de_DE": "Distanz (%)", "es": "Distancia (%)"},
    (
        SENTENCE,
        "For each level, the largest angle between the normals that it shows with its map and those of the "
        "mesh, on 99 % of the texels",
    ): {
        "de_DE": "Für jede Stufe der größte Winkel zwischen den Normalen, die sie mit ihrer Map zeigt, und "
        "denen des Meshes, auf 99 % der Texel",
        "es": "Para cada nivel, el mayor ángulo entre las normales que muestra con su mapa y las de la malla, "
        "en el 99 % de los téxeles",
    },
    (
        SENTENCE,
        "The largest distance of the levels from the mesh, in percent of the longest side of its box: one "
        "number for all levels, or one for each",
    ): {
        "de_DE": "Die größte Distanz der Stufen vom Mesh, in Prozent der längsten Seite seiner Box: eine Zahl "
        "für alle Stufen oder eine für jede",
        "es": "La mayor distancia de los niveles a la malla, en porcentaje del lado más largo de su caja: un "
        "número para todos los niveles, o uno para cada uno",
    },
    (OPERATOR, "Make Levels of Detail"): {"de_DE": "Detailstufen erzeugen", "es": "Crear niveles de detalle"},
    (
        SENTENCE,
        "Make coarser copies of the active mesh with the same UV layout, each with its own map, as coarse as the limits allow",
    ): {
        "de_DE": "Gröbere Kopien des aktiven Meshes mit demselben UV-Layout erzeugen, jede mit eigener Map und "
        "so grob, wie die Grenzwerte erlauben",
        "es": "Crea copias más simples de la malla activa con la misma disposición UV, cada una con su propio "
        "mapa y tan simples como permitan los límites",
    },
    (LABEL, "Measuring"): {"de_DE": "Messen", "es": "Midiendo"},
    (SENTENCE, "Levels of detail are measured on one tile: turn UDIM Tiles off."): {
        "de_DE": "Detailstufen werden auf einer Kachel gemessen: UDIM-Kacheln ausschalten.",
        "es": "Los niveles de detalle se miden en una sola celda: desactivar Celdas UDIM.",
    },
    (SENTENCE, "No limit is set: give at least one number of degrees, or percent of the size."): {
        "de_DE": "Es ist kein Grenzwert gesetzt: mindestens eine Zahl in Grad oder Prozent der Größe angeben.",
        "es": "No hay ningún límite: indicar al menos un número de grados, o un porcentaje del tamaño.",
    },
    (SENTENCE, "No object is active: select the mesh to make levels of."): {
        "de_DE": "Kein Objekt ist aktiv: das Mesh auswählen, von dem Stufen erzeugt werden.",
        "es": "No hay ningún objeto activo: seleccionar la malla de la que crear niveles.",
    },
}
