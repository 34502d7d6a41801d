# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of the panel Output."""

from ...core import file_formats
from ...core.declarations.output_settings import OUTPUT
from .lookup import LABEL, OPERATOR, SENTENCE

TABLE = {
    (LABEL, "Mip Levels"): {"de_DE": "Mip-Stufen", "es": "Niveles mip"},
    (LABEL, "Averaging"): {"de_DE": "Mitteln", "es": "Promediando"},
    (
        SENTENCE,
        "Also write the smaller mip levels to files, such as rock_normal_mip1.png. They average what the map covers, "
        "and widened roughness keeps what the mean of the normals loses",
    ): {
        "de_DE": "Auch die kleineren Mip-Stufen in Dateien schreiben, etwa rock_normal_mip1.png. Sie mitteln, was die Map "
        "bedeckt, und verbreiterte Rauheit behält, was das Mittel der Normalen verliert",
        "es": "Escribe también los niveles mip más pequeños en archivos, como rock_normal_mip1.png. Promedian lo que el "
        "mapa cubre, y la rugosidad ensanchada conserva lo que pierde la media de las normales",
    },
    (LABEL, "Output"): {"de_DE": "Ausgabe", "es": "Salida"},
    (LABEL, "Image"): {"de_DE": "Bild", "es": "Imagen"},
    (
        SENTENCE,
        "Name of the image to fill. {low} in it stands for the low object's name. Leave empty to use an image "
        "named after the low object",
    ): {
        "de_DE": "Name des Bildes, das gefüllt wird. {low} darin steht für den Namen des Low-Poly-Objekts. Leer "
        "lassen, um ein nach dem Low-Poly-Objekt benanntes Bild zu verwenden",
        "es": "Nombre de la imagen a llenar. En él, {low} representa el nombre del objeto low poly. Dejar vacío "
        "para usar una imagen con el nombre del objeto low poly",
    },
    (LABEL, "Names of Maps"): {"de_DE": "Namen von Maps", "es": "Nombres de los mapas"},
    (
        SENTENCE,
        "Names that a preset gives to images and files. {low} in them stands for the low object's name",
    ): {
        "de_DE": "Namen, die eine Voreinstellung Bildern und Dateien gibt. {low} darin steht für den Namen des "
        "Low-Poly-Objekts",
        "es": "Nombres que un preajuste da a imágenes y archivos. En ellos, {low} representa el nombre del objeto low poly",
    },
    (LABEL, "Export"): {"de_DE": "Export", "es": "Exportar"},
    (SENTENCE, OUTPUT["export"].tooltip): {
        "de_DE": f"Datei für eine Engine: {file_formats.listed_meshes('oder')}. Sie bekommt das Low-Poly-Mesh in den "
        "Dreiecken, die gebacken wurden, mit seinen Tangenten und seinen Maps. {low} im Pfad steht für den Namen des "
        "Low-Poly-Objekts",
        "es": f"Archivo para un motor: {file_formats.listed_meshes('o')}. Recibe la malla low poly en los triángulos "
        "que se capturaron, con sus tangentes y sus mapas. En la ruta, {low} representa el nombre del objeto low poly",
    },
    (OPERATOR, "Export for Engine"): {"de_DE": "Für Engine exportieren", "es": "Exportar para un motor"},
    (
        SENTENCE,
        "Write the low object and the maps of its last bake to a file for an engine, read it back, and compare it with the "
        "bake",
    ): {
        "de_DE": "Das Low-Poly-Objekt und die Maps seines letzten Backens in eine Datei für eine Engine schreiben, sie "
        "wieder lesen und mit dem Gebackenen vergleichen",
        "es": "Escribe el objeto low poly y los mapas de su última captura en un archivo para un motor, lo vuelve a leer "
        "y lo compara con la captura",
    },
    (SENTENCE, "File to write; empty for the one in the panel"): {
        "de_DE": "Datei, die geschrieben wird; leer für die im Panel",
        "es": "Archivo a escribir; vacío para el del panel",
    },
    (LABEL, "Writing the file"): {"de_DE": "Datei schreiben", "es": "Escribiendo el archivo"},
    (LABEL, "Reading the file back"): {"de_DE": "Datei zurücklesen", "es": "Releyendo el archivo"},
    (SENTENCE, "The ending decides the format:"): {
        "de_DE": "Die Endung bestimmt das Format:",
        "es": "La extensión determina el formato:",
    },
    (LABEL, "File Filter"): {"de_DE": "Dateifilter", "es": "Filtro de archivos"},
    (SENTENCE, "Names of the files that the file browser lists"): {
        "de_DE": "Namen der Dateien, die der Dateibrowser zeigt",
        "es": "Nombres de los archivos que muestra el explorador de archivos",
    },
    (LABEL, "Check Existing"): {"de_DE": "Vorhandene prüfen", "es": "Comprobar existentes"},
    (SENTENCE, "Warn before a file is replaced"): {
        "de_DE": "Warnen, bevor eine Datei ersetzt wird",
        "es": "Advierte antes de reemplazar un archivo",
    },
    (SENTENCE, "No file is set for the export: set one."): {
        "de_DE": "Für den Export ist keine Datei angegeben: eine angeben.",
        "es": "No se indicó ningún archivo para exportar: indicar uno.",
    },
    (LABEL, "Depth"): {"de_DE": "Tiefe", "es": "Profundidad"},
    (SENTENCE, "Bits per channel. OpenEXR files of maps in scene units, and of attributes, always have 32"): {
        "de_DE": "Bits pro Kanal. OpenEXR-Dateien von Maps in Szeneneinheiten und von Attributen haben immer 32",
        "es": "Bits por canal. Los archivos OpenEXR de mapas en unidades de escena y de atributos siempre tienen 32",
    },
    (SENTENCE, "Smallest. May show steps on smooth surfaces"): {
        "de_DE": "Am kleinsten. Kann auf glatten Oberflächen Stufen zeigen",
        "es": "La más pequeña. Puede mostrar escalones en superficies suaves",
    },
    (SENTENCE, "Smooth: 16-bit PNG or TIFF, half-float OpenEXR, or a float image inside Blender"): {
        "de_DE": "Glatt: PNG oder TIFF mit 16 Bit, OpenEXR mit halber Fließkommagenauigkeit oder ein Fließkommabild "
        "in Blender",
        "es": "Suave: PNG o TIFF de 16 bits, OpenEXR de media precisión decimal o una imagen decimal en Blender",
    },
    (SENTENCE, "Exact: float OpenEXR, or a float image inside Blender"): {
        "de_DE": "Genau: OpenEXR mit Fließkommawerten oder ein Fließkommabild in Blender",
        "es": "Exacta: OpenEXR decimal o una imagen decimal en Blender",
    },
    (LABEL, "Dither"): {"de_DE": "Dithering", "es": "Tramado"},
    (SENTENCE, "Hide the steps of 8 bits in fine noise, instead of rounding to the nearest value"): {
        "de_DE": "Die Stufen von 8 Bit in feinem Rauschen verbergen, statt auf den nächsten Wert zu runden",
        "es": "Oculta los escalones de 8 bits en un ruido fino, en vez de redondear al valor más cercano",
    },
    (LABEL, "UDIM Tiles"): {"de_DE": "UDIM-Kacheln", "es": "Celdas UDIM"},
    (SENTENCE, "Bake a map for each UDIM tile that the low mesh covers"): {
        "de_DE": "Für jede UDIM-Kachel, die das Low-Poly-Mesh bedeckt, eine Map backen",
        "es": "Captura un mapa para cada celda UDIM que cubra la malla low poly",
    },
    (LABEL, "Tiles"): {"de_DE": "Kacheln", "es": "Celdas"},
    (
        SENTENCE,
        "UDIM tiles to bake, such as 1001, 1003. Leave empty to use all tiles that the low mesh covers, 100 at most",
    ): {
        "de_DE": "UDIM-Kacheln, die gebacken werden, etwa 1001, 1003. Leer lassen, um alle Kacheln zu verwenden, "
        "die das Low-Poly-Mesh bedeckt, höchstens 100",
        "es": "Celdas UDIM a capturar, por ejemplo 1001, 1003. Dejar vacío para usar todas las celdas que cubra "
        "la malla low poly, 100 como máximo",
    },
    (LABEL, "Other Maps"): {"de_DE": "Weitere Maps", "es": "Otros mapas"},
    (SENTENCE, "Maps to bake beside the normal map, each into an image of its own"): {
        "de_DE": "Maps, die neben der Normalmap gebacken werden, jede in ein eigenes Bild",
        "es": "Mapas a capturar además del mapa de normales, cada uno en su propia imagen",
    },
    (LABEL, "Position"): {"de_DE": "Position", "es": "Posición"},
    (SENTENCE, "Position of the high surface, in the low object's space or, for world space, in the world's"): {
        "de_DE": "Position der High-Poly-Oberfläche, im Raum des Low-Poly-Objekts oder, beim Raum Welt, in dem der "
        "Welt",
        "es": "Posición de la superficie high poly, en el espacio del objeto low poly o, con el espacio Global, "
        "en el del mundo",
    },
    (SENTENCE, "Distance from the low surface to the high one along the low surface's normal"): {
        "de_DE": "Abstand von der Low-Poly- zur High-Poly-Oberfläche entlang der Normalen der Low-Poly-Oberfläche",
        "es": "Distancia de la superficie low poly a la high poly, a lo largo de la normal de la superficie low poly",
    },
    (LABEL, "Vector Displacement"): {"de_DE": "Vektorverlagerung", "es": "Desplaz. vectorial"},
    (SENTENCE, "Vector from the low surface to the high one"): {
        "de_DE": "Vektor von der Low-Poly- zur High-Poly-Oberfläche",
        "es": "Vector de la superficie low poly a la high poly",
    },
    (LABEL, "Distance"): {"de_DE": "Abstand", "es": "Distancia"},
    (SENTENCE, "Distance from the low surface to the high one in any direction"): {
        "de_DE": "Abstand von der Low-Poly- zur High-Poly-Oberfläche in beliebiger Richtung",
        "es": "Distancia de la superficie low poly a la high poly en cualquier dirección",
    },
    (LABEL, "Coverage"): {"de_DE": "Abdeckung", "es": "Cobertura"},
    (SENTENCE, "White where a high object covers the texel"): {
        "de_DE": "Weiß, wo ein High-Poly-Objekt das Texel bedeckt",
        "es": "Blanco donde un objeto high poly cubre el texel",
    },
    (LABEL, "Object ID"): {"de_DE": "Objekt-ID", "es": "ID de objeto"},
    (SENTENCE, "A color for each high object"): {
        "de_DE": "Eine Farbe für jedes High-Poly-Objekt",
        "es": "Un color para cada objeto high poly",
    },
    (LABEL, "Material ID"): {"de_DE": "Material-ID", "es": "ID de material"},
    (SENTENCE, "A color for each material of the high objects"): {
        "de_DE": "Eine Farbe für jedes Material der High-Poly-Objekte",
        "es": "Un color para cada material de los objetos high poly",
    },
    (LABEL, "Store"): {"de_DE": "Speichern", "es": "Guardar"},
    (SENTENCE, "Where to keep the map"): {"de_DE": "Wo die Map gespeichert wird", "es": "Dónde guardar el mapa"},
    (LABEL, "Packed"): {"de_DE": "Gepackt", "es": "Empacado"},
    (SENTENCE, "Inside the .blend file"): {"de_DE": "In der .blend-Datei", "es": "Dentro del archivo .blend"},
    (LABEL, "File"): {"de_DE": "Datei", "es": "Archivo"},
    (SENTENCE, "In an image file"): {"de_DE": "In einer Bilddatei", "es": "En un archivo de imagen"},
    (LABEL, "Memory"): {"de_DE": "Speicher", "es": "Memoria"},
    (SENTENCE, "In memory until the .blend file is saved, which packs the map"): {
        "de_DE": "Im Arbeitsspeicher, bis die .blend-Datei gespeichert wird; dann wird die Map in sie gepackt",
        "es": "En la memoria hasta que se guarda el archivo .blend, que empaca el mapa",
    },
    (SENTENCE, "The images that were baked for the object, which takes them along into other files"): {
        "de_DE": "Die Bilder, die für das Objekt gebacken wurden und die es in andere Dateien mitnimmt",
        "es": "Las imágenes capturadas para el objeto, que las lleva consigo a otros archivos",
    },
    (SENTENCE, "Image that was baked for the object"): {
        "de_DE": "Bild, das für das Objekt gebacken wurde",
        "es": "Imagen capturada para el objeto",
    },
    (SENTENCE, OUTPUT["output"].tooltip): {  # it lists the formats
        "de_DE": f"Bilddatei, die geschrieben wird: {file_formats.listed('oder', 'Bit')}. Fehlende Ordner werden angelegt. "
        "{low} im Pfad steht für den Namen des Low-Poly-Objekts, <UDIM> für die Nummer der Kachel",
        "es": f"Archivo de imagen a escribir: {file_formats.listed('o')}. Las carpetas que falten se crearán. "
        "En la ruta, {low} representa el nombre del objeto low poly, y <UDIM> el número de la celda",
    },
    (SENTENCE, OUTPUT["alpha"].tooltip): {
        "de_DE": "Dateien haben einen Alphakanal, der auf dem Hintergrund und ohne Treffer 0 ist. Ohne ihn sind sie "
        "kleiner",
        "es": "Los archivos tienen un canal alfa, que es 0 en el fondo y donde los rayos no alcanzan nada. Sin él ocupan "
        "menos",
    },
    (SENTENCE, "Add the map to the low object's material"): {
        "de_DE": "Die Map dem Material des Low-Poly-Objekts hinzufügen",
        "es": "Adiciona el mapa al material del objeto low poly",
    },
    (LABEL, "Single User"): {"de_DE": "Eigene Kopie", "es": "Copia propia"},
    (SENTENCE, "Copy materials that other objects use as well, so that those objects keep their look"): {
        "de_DE": "Materialien kopieren, die auch andere Objekte verwenden, damit deren Aussehen erhalten bleibt",
        "es": "Copia los materiales que también usan otros objetos, para que éstos conserven su aspecto",
    },
    (LABEL, "Show Result"): {"de_DE": "Ergebnis anzeigen", "es": "Mostrar resultado"},
    (
        SENTENCE,
        "After a bake, show the map in an open Image Editor and the low mesh with it in the 3D viewport: with "
        "Material Preview instead of Solid, and the high objects hidden",
    ): {
        "de_DE": "Nach dem Backen die Map in einem offenen Bildeditor anzeigen und das Low-Poly-Mesh mit ihr im "
        "3D-Ansichtsfenster: mit Materialbeispiel statt Massiv und mit verborgenen High-Poly-Objekten",
        "es": "Tras la captura, muestra el mapa en un Editor de imágenes abierto y la malla low poly con él en "
        "la Vista 3D: con Previsualización de materiales en vez de Sólido, y los objetos high poly ocultos",
    },
}
