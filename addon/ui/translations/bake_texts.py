# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of the panels Imprint and Report, and of the operators that bake one map."""

from .lookup import LABEL, OPERATOR, SENTENCE

TABLE = {
    (LABEL, "High"): {"de_DE": "High-Poly", "es": "High poly"},
    (
        SENTENCE,
        "High-poly objects, which have the detail: meshes, curves, text, or objects that show instances. Leave "
        "empty to use the selected objects",
    ): {
        "de_DE": "High-Poly-Objekte mit den Details: Meshes, Kurven, Text oder Objekte, die Instanzen zeigen. Leer "
        "lassen, um die ausgewählten Objekte zu verwenden",
        "es": "Objetos high poly, que tienen el detalle: mallas, curvas, textos u objetos que muestran "
        "instancias. Dejar vacío para usar los objetos seleccionados",
    },
    (SENTENCE, "Object with detail: a mesh, a curve, text, or an object that shows instances"): {
        "de_DE": "Objekt mit Details: ein Mesh, eine Kurve, Text oder ein Objekt, das Instanzen zeigt",
        "es": "Objeto con detalle: una malla, una curva, un texto o un objeto que muestra instancias",
    },
    (SENTENCE, "{} was deleted: bring it back, or remove it."): {
        "de_DE": "{} wurde gelöscht: zurückholen oder entfernen.",
        "es": "{} se ha borrado: recuperarlo o quitarlo.",
    },
    (SENTENCE, "{} is hidden."): {"de_DE": "{} ist ausgeblendet.", "es": "{} está oculto."},
    (SENTENCE, "{} are hidden."): {"de_DE": "{} sind ausgeblendet.", "es": "{} están ocultos."},
    (OPERATOR, "Show"): {"de_DE": "Einblenden", "es": "Mostrar"},
    (SENTENCE, "Show the hidden high objects in the viewport. Without others, they are selected"): {
        "de_DE": "Die ausgeblendeten High-Poly-Objekte im Viewport zeigen. Ohne andere werden sie ausgewählt",
        "es": "Muestra en la vista los objetos high poly ocultos. Si no hay otros, se seleccionan",
    },
    (OPERATOR, "Remove"): {"de_DE": "Entfernen", "es": "Quitar"},
    (SENTENCE, "Remove a high object that was deleted from the slots, or from the pair of the low object"): {
        "de_DE": "Ein gelöschtes High-Poly-Objekt aus den Einträgen oder aus dem Paar des Low-Poly-Objekts entfernen",
        "es": "Quita un objeto high poly borrado de las entradas o del par del objeto low poly",
    },
    (SENTENCE, "Name of the high object; empty for all that are missing"): {
        "de_DE": "Name des High-Poly-Objekts; leer für alle fehlenden",
        "es": "Nombre del objeto high poly; vacío para todos los que faltan",
    },
    (LABEL, "Name"): {"de_DE": "Name", "es": "Nombre"},
    (SENTENCE, "Name of the object when the file was saved, by which it is found if it was deleted and comes back"): {
        "de_DE": "Name des Objekts beim Speichern der Datei, über den es gefunden wird, wenn es gelöscht war und zurückkommt",
        "es": "Nombre del objeto al guardar el archivo, con el que se encuentra si se borró y vuelve",
    },
    (SENTENCE, "The high objects of the last bake"): {
        "de_DE": "Die High-Poly-Objekte des letzten Backens",
        "es": "Los objetos high poly de la última captura",
    },
    (LABEL, "Own Modifiers"): {"de_DE": "Eigene Modifikatoren", "es": "Modificadores propios"},
    (SENTENCE, "Whether the last bake was of the object's own modifiers"): {
        "de_DE": "Ob das letzte Backen die eigenen Modifikatoren des Objekts gezeigt hat",
        "es": "Si la última captura fue de los modificadores propios del objeto",
    },
    (SENTENCE, "The reports of the last bake, in JSON"): {
        "de_DE": "Die Berichte des letzten Backens, in JSON",
        "es": "Los informes de la última captura, en JSON",
    },
    (LABEL, "Baked"): {"de_DE": "Gebacken", "es": "Capturado"},
    (SENTENCE, "Time of the last bake, in UTC"): {
        "de_DE": "Zeit des letzten Backens, in UTC",
        "es": "Hora de la última captura, en UTC",
    },
    (LABEL, "Active High"): {"de_DE": "Aktiver High-Poly-Eintrag", "es": "High poly activo"},
    (SENTENCE, "Index of the selected slot"): {
        "de_DE": "Index des ausgewählten Eintrags",
        "es": "Índice de la entrada seleccionada",
    },
    (OPERATOR, "Connect Maps"): {"de_DE": "Maps verbinden", "es": "Conectar mapas"},
    (
        SENTENCE,
        "Put the maps of the last bake into the low object's material: colors, roughness, metallic, occlusion and height",
    ): {
        "de_DE": "Die Maps des letzten Backens in das Material des Low-Poly-Objekts einsetzen: Farben, Rauheit, Metallisch, "
        "Verdeckung und Höhe",
        "es": "Pone los mapas de la última captura en el material del objeto low poly: colores, rugosidad, metalicidad, "
        "oclusión y altura",
    },
    (SENTENCE, "Bake a map first that a material takes, such as base color"): {
        "de_DE": "Zuerst eine Map backen, die ein Material verwendet, zum Beispiel die Grundfarbe",
        "es": "Capturar antes un mapa que use un material, como el color base",
    },
    (OPERATOR, "Add High Object"): {"de_DE": "High-Poly-Objekt hinzufügen", "es": "Adicionar objeto high poly"},
    (SENTENCE, "Add a slot for a high object"): {
        "de_DE": "Einen Eintrag für ein High-Poly-Objekt hinzufügen",
        "es": "Adiciona una entrada para un objeto high poly",
    },
    (OPERATOR, "Remove High Object"): {"de_DE": "High-Poly-Objekt entfernen", "es": "Quitar objeto high poly"},
    (SENTENCE, "Remove a slot; its object stays in the scene"): {
        "de_DE": "Einen Eintrag entfernen; sein Objekt bleibt in der Szene",
        "es": "Quita una entrada; su objeto permanece en la escena",
    },
    (LABEL, "Index"): {"de_DE": "Index", "es": "Índice"},
    (SENTENCE, "Index of the slot, from 0; below 0 for the active slot"): {
        "de_DE": "Index des Eintrags, ab 0; unter 0 für den aktiven Eintrag",
        "es": "Índice de la entrada, desde 0; menor que 0 para la entrada activa",
    },
    (LABEL, "Low"): {"de_DE": "Low-Poly", "es": "Low poly"},
    (SENTENCE, "Low-poly mesh, which gets the map. Leave empty to use the active object"): {
        "de_DE": "Low-Poly-Mesh, das die Map erhält. Leer lassen, um das aktive Objekt zu verwenden",
        "es": "Malla low poly, que recibe el mapa. Dejar vacío para usar el objeto activo",
    },
    (OPERATOR, "Fill from Selection"): {"de_DE": "Aus Auswahl füllen", "es": "Llenar con la selección"},
    (
        SENTENCE,
        "Fill the slots: the active object becomes the low object, the other selected objects with a surface the "
        "high objects",
    ): {
        "de_DE": "Die Einträge füllen: Das aktive Objekt wird das Low-Poly-Objekt, die anderen ausgewählten Objekte "
        "mit einer Oberfläche werden die High-Poly-Objekte",
        "es": "Llena las entradas: el objeto activo será el objeto low poly, y los demás objetos seleccionados "
        "que tengan superficie, los objetos high poly",
    },
    (OPERATOR, "Bake Normal Map"): {"de_DE": "Normalmap backen", "es": "Capturar mapa de normales"},
    (SENTENCE, "Bake the detail of the high-poly objects into a normal map for the low-poly object"): {
        "de_DE": "Die Details der High-Poly-Objekte in eine Normalmap für das Low-Poly-Objekt backen",
        "es": "Captura el detalle de los objetos high poly en un mapa de normales para el objeto low poly",
    },
    (SENTENCE, "Name of the low object; empty for the slot or the active object"): {
        "de_DE": "Name des Low-Poly-Objekts; leer für den Eintrag oder das aktive Objekt",
        "es": "Nombre del objeto low poly; vacío para usar la entrada o el objeto activo",
    },
    (SENTENCE, 'Names of the high objects, as [{"name": "sculpt"}]; empty for the slots or the selection'): {
        "de_DE": 'Namen der High-Poly-Objekte, als [{"name": "sculpt"}]; leer für die Einträge oder die Auswahl',
        "es": 'Nombres de los objetos high poly, como [{"name": "sculpt"}]; vacío para usar las entradas o la '
        "selección",
    },
    (SENTENCE, "Name of the cage; empty for the slot, which only rays use"): {
        "de_DE": "Name des Käfigs; leer für den Eintrag, den nur Strahlen verwenden",
        "es": "Nombre de la jaula; vacío para usar la entrada, que sólo usan los rayos",
    },
    (OPERATOR, "Live"): {"de_DE": "Live", "es": "En vivo"},
    (SENTENCE, "Bake again whenever the high or low objects change, until it is switched off"): {
        "de_DE": "Bei jeder Änderung der High-Poly- oder Low-Poly-Objekte erneut backen, bis Live ausgeschaltet wird",
        "es": "Vuelve a capturar cada vez que cambien los objetos high poly o low poly, hasta que se desactive",
    },
    (LABEL, "Write Every Map"): {"de_DE": "Alle schreiben", "es": "Escribir todos"},
    (SENTENCE, "While Live is on, write each map to the image at once, and not only when editing pauses"): {
        "de_DE": "Solange Live eingeschaltet ist, jede Map sofort in das Bild schreiben, nicht erst in einer "
        "Bearbeitungspause",
        "es": "Mientras En vivo esté activado, escribe cada mapa en la imagen de inmediato, y no sólo en las "
        "pausas de la edición",
    },
    (SENTENCE, "Stop Live first: it writes to the same image"): {
        "de_DE": "Zuerst Live ausschalten: Es schreibt in dasselbe Bild",
        "es": "Desactivar antes En vivo: escribe en la misma imagen",
    },
    (SENTENCE, "Live: {} follows {}."): {"de_DE": "Live: {} folgt {}.", "es": "En vivo: {} sigue a {}."},
    (OPERATOR, "Stop"): {"de_DE": "Anhalten", "es": "Detener"},
    (SENTENCE, "Stop the running bake; maps that are done are kept"): {
        "de_DE": "Das laufende Backen anhalten; fertige Maps bleiben erhalten",
        "es": "Detiene la captura en curso; los mapas terminados se conservan",
    },
    (SENTENCE, "Bakes {highs} onto {low}"): {"de_DE": "Backt {highs} auf {low}", "es": "Captura {highs} sobre {low}"},
    (SENTENCE, "Flattens {highs} onto {low}"): {
        "de_DE": "Flacht {highs} auf {low} ab",
        "es": "Aplana {highs} sobre {low}",
    },
    (SENTENCE, "Casts rays from {low} to {highs}"): {
        "de_DE": "Wirft Strahlen von {low} auf {highs}",
        "es": "Proyecta rayos desde {low} hacia {highs}",
    },
    (SENTENCE, "its own modifiers"): {"de_DE": "die eigenen Modifikatoren", "es": "sus propios modificadores"},
    (SENTENCE, "tangent space"): {"de_DE": "Tangentenraum", "es": "espacio tangencial"},
    (SENTENCE, "object space"): {"de_DE": "Objektraum", "es": "espacio del objeto"},
    (SENTENCE, "world space"): {"de_DE": "Weltraum", "es": "espacio global"},
    (SENTENCE, "over the image {}"): {"de_DE": "über das Bild {}", "es": "sobre la imagen {}"},
    (SENTENCE, "into a new image {}"): {"de_DE": "in ein neues Bild {}", "es": "en una imagen nueva {}"},
    (SENTENCE, "which holds a map of {}"): {"de_DE": "das eine Map von {} enthält", "es": "que contiene un mapa de {}"},
    (SENTENCE, "to the file {}"): {"de_DE": "in die Datei {}", "es": "en el archivo {}"},
    (SENTENCE, "{low} has more faces than {highs}. Are they swapped?"): {
        "de_DE": "{low} hat mehr Flächen als {highs}. Sind sie vertauscht?",
        "es": "{low} tiene más caras que {highs}. ¿Están intercambiados?",
    },
    (SENTENCE, "The image was undone, renamed or deleted"): {
        "de_DE": "Das Bild wurde rückgängig gemacht, umbenannt oder gelöscht",
        "es": "La imagen fue deshecha, renombrada o eliminada",
    },
    (SENTENCE, "1 warning"): {"de_DE": "1 Warnung", "es": "1 advertencia"},
    (SENTENCE, "{} warnings"): {"de_DE": "{} Warnungen", "es": "{} advertencias"},
    (SENTENCE, "{} covered"): {"de_DE": "{} abgedeckt", "es": "{} cubierto"},
    (OPERATOR, "Show High"): {"de_DE": "High-Poly anzeigen", "es": "Mostrar high poly"},
    (SENTENCE, "Hide the high objects of the last bake to see the low object with its map, or show them again"): {
        "de_DE": "Die High-Poly-Objekte des letzten Backvorgangs verbergen, um das Low-Poly-Objekt mit seiner Map "
        "zu sehen, oder sie wieder anzeigen",
        "es": "Oculta los objetos high poly de la última captura para ver el objeto low poly con su mapa, o los "
        "vuelve a mostrar",
    },
    (LABEL, "Report"): {"de_DE": "Bericht", "es": "Reporte"},
    (LABEL, "Last Bake"): {"de_DE": "Letzter Backvorgang", "es": "Última captura"},
    (SENTENCE, "Summary of this session's last bake, one item per line"): {
        "de_DE": "Zusammenfassung des letzten Backvorgangs dieser Sitzung, ein Punkt pro Zeile",
        "es": "Resumen de la última captura de esta sesión, un elemento por línea",
    },
    (LABEL, "Warnings"): {"de_DE": "Warnungen", "es": "Advertencias"},
    (SENTENCE, "Warnings of this session's last bake, one per line"): {
        "de_DE": "Warnungen des letzten Backvorgangs dieser Sitzung, eine pro Zeile",
        "es": "Advertencias de la última captura de esta sesión, una por línea",
    },
}
