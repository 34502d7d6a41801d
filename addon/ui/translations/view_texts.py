# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of the panel View, and of what the viewports show."""

from .lookup import LABEL, OPERATOR, SENTENCE

TABLE = {
    (LABEL, "View"): {"de_DE": "Ansicht", "es": "Vista"},
    (SENTENCE, "What the 3D viewport shows"): {
        "de_DE": "Was das 3D-Ansichtsfenster zeigt",
        "es": "Lo que muestra la Vista 3D",
    },
    (LABEL, "Off"): {"de_DE": "Aus", "es": "Desactivada"},
    (SENTENCE, "The viewport as it is"): {"de_DE": "Das Ansichtsfenster, wie es ist", "es": "La vista tal como es"},
    (SENTENCE, "The low mesh with the map, lit"): {
        "de_DE": "Das Low-Poly-Mesh mit der Map, beleuchtet",
        "es": "La malla low poly con el mapa, iluminada",
    },
    (SENTENCE, "The high mesh, the low mesh, and the low mesh with the map, side by side in one place"): {
        "de_DE": "Das High-Poly-Mesh, das Low-Poly-Mesh und das Low-Poly-Mesh mit der Map, nebeneinander an einem Ort",
        "es": "La malla high poly, la malla low poly y la malla low poly con el mapa, lado a lado en un mismo lugar",
    },
    (LABEL, "Deviation"): {"de_DE": "Abweichung", "es": "Desviación"},
    (SENTENCE, "Degrees between the low mesh with the map and the high surface"): {
        "de_DE": "Winkel in Grad zwischen dem Low-Poly-Mesh mit der Map und der High-Poly-Oberfläche",
        "es": "Grados entre la malla low poly con el mapa y la superficie high poly",
    },
    (LABEL, "Without Map"): {"de_DE": "Ohne Map", "es": "Sin mapa"},
    (SENTENCE, "Degrees between the low mesh without the map and the high surface"): {
        "de_DE": "Winkel in Grad zwischen dem Low-Poly-Mesh ohne die Map und der High-Poly-Oberfläche",
        "es": "Grados entre la malla low poly sin el mapa y la superficie high poly",
    },
    (
        SENTENCE,
        "{reader} reads green as {wanted}, and the map stores {stored}: the preset {preset} of the Map panel sets it.",
    ): {
        "de_DE": "{reader} liest Grün als {wanted}, und die Map speichert {stored}: Die Voreinstellung {preset} im Panel Map "
        "stellt es ein.",
        "es": "{reader} lee el verde como {wanted} y el mapa guarda {stored}: el preajuste {preset} del panel Mapa lo define.",
    },
    (LABEL, "Light"): {"de_DE": "Licht", "es": "Luz"},
    (SENTENCE, "The light that shines on the mesh; without one, a light that follows the view"): {
        "de_DE": "Das Licht, das auf das Mesh scheint; ohne Auswahl ein Licht, das der Ansicht folgt",
        "es": "La luz que ilumina la malla; sin ninguna, una luz que sigue a la vista",
    },
    (LABEL, "Line"): {"de_DE": "Linie", "es": "Línea"},
    (SENTENCE, "Position of the line between high and low, as a share of the view's width"): {
        "de_DE": "Position der Linie zwischen High-Poly und Low-Poly, als Anteil der Breite der Ansicht",
        "es": "Posición de la línea entre high poly y low poly, como fracción del ancho de la vista",
    },
    (LABEL, "Range"): {"de_DE": "Bereich", "es": "Rango"},
    (SENTENCE, "Degrees at the end of the color scale"): {
        "de_DE": "Grad am Ende der Farbskala",
        "es": "Grados al final de la escala de colores",
    },
    (OPERATOR, "Show View"): {"de_DE": "Ansicht anzeigen", "es": "Mostrar vista"},
    (SENTENCE, "Show in the 3D viewport what the map does"): {
        "de_DE": "Im 3D-Ansichtsfenster zeigen, was die Map bewirkt",
        "es": "Muestra en la Vista 3D lo que hace el mapa",
    },
    (OPERATOR, "Next View"): {"de_DE": "Nächste Ansicht", "es": "Vista siguiente"},
    (SENTENCE, "Show the next view: map, split, deviation, deviation without the map, off"): {
        "de_DE": "Die nächste Ansicht zeigen: Map, geteilt, Abweichung, Abweichung ohne Map, aus",
        "es": "Muestra la vista siguiente: mapa, dividir, desviación, desviación sin el mapa, desactivada",
    },
    (OPERATOR, "Refresh View"): {"de_DE": "Ansicht aktualisieren", "es": "Refrescar vista"},
    (SENTENCE, "Draw the map of the view again, from the current objects and settings"): {
        "de_DE": "Die Map der Ansicht aus den aktuellen Objekten und Einstellungen neu zeichnen",
        "es": "Vuelve a dibujar el mapa de la vista, con los objetos y opciones actuales",
    },
    (SENTENCE, "The settings have changed: refresh the view."): {
        "de_DE": "Die Einstellungen haben sich geändert: Ansicht aktualisieren.",
        "es": "Las opciones han cambiado: refrescar la vista.",
    },
    (LABEL, "Low with Map"): {"de_DE": "Low-Poly mit Map", "es": "Low poly con mapa"},
    (SENTENCE, "With the map: mean {}, 99 % below {}"): {
        "de_DE": "Mit der Map: Mittelwert {}, 99 % unter {}",
        "es": "Con el mapa: media {}, 99 % por debajo de {}",
    },
    (SENTENCE, "Without: mean {}, 99 % below {}"): {
        "de_DE": "Ohne: Mittelwert {}, 99 % unter {}",
        "es": "Sin él: media {}, 99 % por debajo de {}",
    },
    (SENTENCE, "Purple: {} shows another place of the high mesh and is not measured: cast rays"): {
        "de_DE": "Violett: {} zeigt eine andere Stelle des High-Poly-Meshes und wird nicht gemessen: Methode "
        "Strahlen verwenden",
        "es": "Púrpura: {} muestra otro lugar de la malla high poly y no se mide: usar el método Proyectar",
    },
    (LABEL, "Reader"): {"de_DE": "Leser", "es": "Lector"},
    (
        SENTENCE,
        "Program as which the view reads a tangent-space map. It shows what the program would show of this map",
    ): {
        "de_DE": "Programm, als das die Ansicht eine Map im Tangentenraum liest. Sie zeigt, was das Programm von dieser Map "
        "zeigen würde",
        "es": "Programa como el que la vista lee un mapa en espacio tangente. Muestra lo que el programa mostraría de este "
        "mapa",
    },
    (LABEL, "As Baked"): {"de_DE": "Wie gebacken", "es": "Como se procesó"},
    (SENTENCE, "The program that the map is made for"): {
        "de_DE": "Das Programm, für das die Map gemacht ist",
        "es": "El programa para el que está hecho el mapa",
    },
}
