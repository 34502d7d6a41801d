# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of the panels Map and Channels, and of their presets."""

from .lookup import LABEL, OPERATOR, SENTENCE

TABLE = {
    (LABEL, "Map"): {"de_DE": "Map", "es": "Mapa"},
    (LABEL, "Method"): {"de_DE": "Methode", "es": "Método"},
    (SENTENCE, "How the detail of the high mesh gets into the map"): {
        "de_DE": "Wie die Details des High-Poly-Meshes in die Map gelangen",
        "es": "Cómo llega al mapa el detalle de la malla high poly",
    },
    (
        SENTENCE,
        "Flatten where the meshes share their UV layout, else Cast. The report says which method was used, and why",
    ): {
        "de_DE": "Abflachen, wenn die Meshes dasselbe UV-Layout haben, sonst Strahlen. Der Bericht nennt die "
        "verwendete Methode und den Grund",
        "es": "Aplanar si las mallas comparten su disposición UV; si no, Proyectar. El reporte indica qué método "
        "se usó y por qué",
    },
    (LABEL, "Flatten"): {"de_DE": "Abflachen", "es": "Aplanar"},
    (SENTENCE, "Draw the high mesh in UV space. Both meshes must share their UV layout"): {
        "de_DE": "Das High-Poly-Mesh im UV-Raum zeichnen. Beide Meshes müssen dasselbe UV-Layout haben",
        "es": "Dibuja la malla high poly en el espacio UV. Ambas mallas deben compartir su disposición UV",
    },
    (LABEL, "Cast"): {"de_DE": "Strahlen", "es": "Proyectar"},
    (SENTENCE, "Cast rays from the low mesh to the high mesh. The meshes must lie in the same place"): {
        "de_DE": "Strahlen vom Low-Poly-Mesh auf das High-Poly-Mesh werfen. Die Meshes müssen am selben Ort liegen",
        "es": "Proyecta rayos desde la malla low poly hacia la malla high poly. Las mallas deben estar en el "
        "mismo lugar",
    },
    (LABEL, "Space"): {"de_DE": "Raum", "es": "Espacio"},
    (SENTENCE, "Space of the normals"): {"de_DE": "Raum der Normalen", "es": "Espacio de las normales"},
    (LABEL, "Tangent"): {"de_DE": "Tangente", "es": "Tangente"},
    (SENTENCE, "Relative to the low surface. The mesh may deform, and the map may tile"): {
        "de_DE": "Relativ zur Low-Poly-Oberfläche. Das Mesh darf sich verformen, die Map darf gekachelt sein",
        "es": "Relativo a la superficie low poly. La malla puede deformarse y el mapa puede repetirse",
    },
    (LABEL, "Object"): {"de_DE": "Objekt", "es": "Objeto"},
    (SENTENCE, "Relative to the low object. The object may move, its mesh may not deform"): {
        "de_DE": "Relativ zum Low-Poly-Objekt. Das Objekt darf sich bewegen, sein Mesh darf sich nicht verformen",
        "es": "Relativo al objeto low poly. El objeto puede moverse, su malla no puede deformarse",
    },
    (LABEL, "World"): {"de_DE": "Welt", "es": "Global"},
    (SENTENCE, "Relative to the scene. The object may not move"): {
        "de_DE": "Relativ zur Szene. Das Objekt darf sich nicht bewegen",
        "es": "Relativo a la escena. El objeto no puede moverse",
    },
    (LABEL, "Basis"): {"de_DE": "Basis", "es": "Base"},
    (SENTENCE, "Tangent basis that the map is decoded with. Renderers differ by a few degrees on coarse meshes"): {
        "de_DE": "Tangentenbasis, mit der die Map dekodiert wird. Bei groben Meshes weichen Renderer um einige Grad "
        "voneinander ab",
        "es": "Base tangente con la que se decodifica el mapa. En mallas toscas los motores difieren en unos "
        "pocos grados",
    },
    (LABEL, "Scene's Engine"): {"de_DE": "Engine der Szene", "es": "Motor de la escena"},
    (SENTENCE, "The basis that the scene's render engine uses: Cycles its own, all others MikkTSpace"): {
        "de_DE": "Die Basis, die die Renderengine der Szene verwendet: Cycles eine eigene, alle anderen MikkTSpace",
        "es": "La base que usa el motor de procesamiento de la escena: Cycles la suya, todos los demás MikkTSpace",
    },
    (SENTENCE, "Cycles' Normal Map node, which normalizes only the interpolated normal"): {
        "de_DE": "Der Normalmap-Node von Cycles, der nur die interpolierte Normale normalisiert",
        "es": "El nodo Mapa de normales de Cycles, que sólo normaliza la normal interpolada",
    },
    (SENTENCE, "The bitangent is made for each pixel: EEVEE, Material Preview, Unreal Engine, Unity URP and HDRP"): {
        "de_DE": "Die Bitangente entsteht in jedem Pixel: EEVEE, Materialbeispiel, Unreal Engine, Unity URP und HDRP",
        "es": "La bitangente se calcula en cada píxel: EEVEE, Previsualización de materiales, Unreal Engine, Unity URP y HDRP",
    },
    (LABEL, "MikkTSpace, Vertex Bitangent"): {
        "de_DE": "MikkTSpace, Bitangente der Vertices",
        "es": "MikkTSpace, bitangente de vértices",
    },
    (
        SENTENCE,
        "The bitangent is made at the vertices and interpolated: Unity Built-in, Godot 4.4 and later, Babylon.js, CryEngine, "
        "xNormal",
    ): {
        "de_DE": "Die Bitangente entsteht an den Vertices und wird interpoliert: Unity Built-in, Godot ab 4.4, Babylon.js, "
        "CryEngine, xNormal",
        "es": "La bitangente se calcula en los vértices y se interpola: Unity Built-in, Godot 4.4 y posteriores, Babylon.js, "
        "CryEngine, xNormal",
    },
    (LABEL, "All Normalized"): {"de_DE": "Alle normalisiert", "es": "Todo normalizado"},
    (
        SENTENCE,
        "The bitangent is made at the vertices, and tangent, bitangent and normal are normalized for each pixel: three.js, "
        "Khronos glTF viewer",
    ): {
        "de_DE": "Die Bitangente entsteht an den Vertices, und Tangente, Bitangente und Normale werden in jedem Pixel "
        "normalisiert: three.js, Khronos glTF Viewer",
        "es": "La bitangente se calcula en los vértices, y tangente, bitangente y normal se normalizan en cada píxel: "
        "three.js, visor glTF de Khronos",
    },
    (LABEL, "Readers"): {"de_DE": "Leser", "es": "Lectores"},
    (
        SENTENCE,
        "Programs for which the report says by how many degrees they are off when they read this tangent-space map",
    ): {
        "de_DE": "Programme, für die der Bericht sagt, um wie viel Grad sie abweichen, wenn sie diese Map im Tangentenraum "
        "lesen",
        "es": "Programas para los que el informe dice en cuántos grados difieren al leer este mapa en espacio tangente",
    },
    (SENTENCE, "It decodes with the basis Cycles"): {
        "de_DE": "Dekodiert mit der Basis Cycles",
        "es": "Decodifica con la base Cycles",
    },
    (SENTENCE, "It decodes with the basis MikkTSpace"): {
        "de_DE": "Dekodiert mit der Basis MikkTSpace",
        "es": "Decodifica con la base MikkTSpace",
    },
    (SENTENCE, "It decodes with the basis MikkTSpace, Vertex Bitangent"): {
        "de_DE": "Dekodiert mit der Basis MikkTSpace, Bitangente der Vertices",
        "es": "Decodifica con la base MikkTSpace, bitangente de vértices",
    },
    (SENTENCE, "It decodes with the basis All Normalized"): {
        "de_DE": "Dekodiert mit der Basis Alle normalisiert",
        "es": "Decodifica con la base Todo normalizado",
    },
    (LABEL, "UV Map"): {"de_DE": "UV-Map", "es": "Mapa UV"},
    (SENTENCE, "UV map of the low mesh. Leave empty to use the active one"): {
        "de_DE": "UV-Map des Low-Poly-Meshes. Leer lassen, um die aktive zu verwenden",
        "es": "Mapa UV de la malla low poly. Dejar vacío para usar el activo",
    },
    (LABEL, "Size"): {"de_DE": "Größe", "es": "Tamaño"},
    (SENTENCE, "Width and height of the map, in texels"): {
        "de_DE": "Breite und Höhe der Map, in Texeln",
        "es": "Ancho y alto del mapa, en texels",
    },
    (LABEL, "Width"): {"de_DE": "Breite", "es": "Ancho"},
    (SENTENCE, "Width of the map, in texels"): {
        "de_DE": "Breite der Map, in Texeln",
        "es": "Ancho del mapa, en texels",
    },
    (LABEL, "Height"): {"de_DE": "Höhe", "es": "Altura"},
    (SENTENCE, "Height of the map, in texels"): {
        "de_DE": "Höhe der Map, in Texeln",
        "es": "Altura del mapa, en texels",
    },
    (LABEL, "Square"): {"de_DE": "Quadratisch", "es": "Cuadrado"},
    (SENTENCE, "Use one size for width and height"): {
        "de_DE": "Eine Größe für Breite und Höhe verwenden",
        "es": "Usa un mismo tamaño para el ancho y la altura",
    },
    (OPERATOR, "Resize Map"): {"de_DE": "Map-Größe ändern", "es": "Redimensionar mapa"},
    (SENTENCE, "Change the size of the map; a map that is not square keeps its shape"): {
        "de_DE": "Die Größe der Map ändern; das Seitenverhältnis bleibt erhalten",
        "es": "Cambia el tamaño del mapa; si no es cuadrado, conserva su proporción",
    },
    (LABEL, "Side"): {"de_DE": "Seite", "es": "Lado"},
    (SENTENCE, "Texels along the longer side; 0 to scale"): {
        "de_DE": "Texel entlang der längeren Seite; 0, um zu skalieren",
        "es": "Texels a lo largo del lado mayor; 0 para escalar",
    },
    (LABEL, "Factor"): {"de_DE": "Faktor", "es": "Factor"},
    (SENTENCE, "By how much both sides are scaled"): {
        "de_DE": "Faktor, um den beide Seiten skaliert werden",
        "es": "Factor por el que se escalan ambos lados",
    },
    (LABEL, "Double"): {"de_DE": "Verdoppeln", "es": "Duplicar"},
    (LABEL, "Halve"): {"de_DE": "Halbieren", "es": "Reducir a la mitad"},
    (LABEL, "Samples"): {"de_DE": "Abtastwerte", "es": "Muestras"},
    (
        SENTENCE,
        "Samples per texel, for antialiasing. Use 1 for a preview, and 4 or more for the final map: 4 samples take "
        "2 to 3 times as long and leave a fifth of the error",
    ): {
        "de_DE": "Abtastwerte pro Texel, für Antialiasing. 1 für eine Vorschau, 4 oder mehr für die endgültige Map: "
        "4 Abtastwerte dauern 2- bis 3-mal so lange und lassen ein Fünftel des Fehlers übrig",
        "es": "Muestras por texel, para suavizar los bordes. 1 para una previsualización, 4 o más para el mapa "
        "final: 4 muestras tardan de 2 a 3 veces más y dejan una quinta parte del error",
    },
    (SENTENCE, "One sample, at the texel's center"): {
        "de_DE": "Ein Abtastwert, in der Mitte des Texels",
        "es": "Una muestra, en el centro del texel",
    },
    (SENTENCE, "The mean of 2 samples"): {"de_DE": "Der Mittelwert von 2 Abtastwerten", "es": "La media de 2 muestras"},
    (SENTENCE, "The mean of 4 samples"): {"de_DE": "Der Mittelwert von 4 Abtastwerten", "es": "La media de 4 muestras"},
    (SENTENCE, "The mean of 8 samples"): {"de_DE": "Der Mittelwert von 8 Abtastwerten", "es": "La media de 8 muestras"},
    (SENTENCE, "The mean of 16 samples"): {
        "de_DE": "Der Mittelwert von 16 Abtastwerten",
        "es": "La media de 16 muestras",
    },
    (SENTENCE, "The mean of 64 samples"): {
        "de_DE": "Der Mittelwert von 64 Abtastwerten",
        "es": "La media de 64 muestras",
    },
    (LABEL, "Adaptive Sampling"): {"de_DE": "Adaptives Abtasten", "es": "Muestreo adaptable"},
    (
        SENTENCE,
        "Take all samples only at borders and where the first ones differ. In 99 of 100 texels, the normal is within "
        "0.02 degrees of the mean of all samples. Bakes of several maps, and Flatten with fewer than 64 samples, take all "
        "samples everywhere",
    ): {
        "de_DE": "Nur an Rändern und wo sich die ersten unterscheiden alle Abtastwerte verwenden. In 99 von 100 Texeln "
        "weicht die Normale höchstens 0,02 Grad vom Mittelwert aller Abtastwerte ab. Bei mehreren Maps und bei Flatten mit "
        "weniger als 64 Abtastwerten werden überall alle verwendet",
        "es": "Usar todas las muestras solo en los bordes y donde las primeras difieren. En 99 de cada 100 texels, la normal "
        "difiere como máximo 0,02 grados de la media de todas las muestras. Con varios mapas, y con Flatten y menos de 64 "
        "muestras, se usan todas en todas partes",
    },
    (LABEL, "Margin Type"): {"de_DE": "Randtyp", "es": "Tipo de margen"},
    (SENTENCE, "How the margin is filled"): {"de_DE": "Wie der Rand gefüllt wird", "es": "Cómo se rellena el margen"},
    (LABEL, "Extend"): {"de_DE": "Erweitern", "es": "Extender"},
    (SENTENCE, "Repeat the nearest texel of an island"): {
        "de_DE": "Das nächste Texel einer Insel wiederholen",
        "es": "Repite el texel más cercano de una isla",
    },
    (LABEL, "Adjacent Faces"): {"de_DE": "Angrenzende Flächen", "es": "Caras adyacentes"},
    (SENTENCE, "Continue the neighboring face across the seam, with normals rotated to fit"): {
        "de_DE": "Die angrenzende Fläche über die Naht hinaus fortsetzen, mit passend gedrehten Normalen",
        "es": "Continúa la cara vecina a través de la costura, con las normales rotadas para que encajen",
    },
    (LABEL, "Margin"): {"de_DE": "Rand", "es": "Margen"},
    (SENTENCE, "Width of the margin around UV islands, in texels. It keeps the background from showing at seams"): {
        "de_DE": "Breite des Randes um UV-Inseln, in Texeln. Er verhindert, dass an Nähten der Hintergrund sichtbar "
        "wird",
        "es": "Ancho del margen alrededor de las islas UV, en texels. Evita que el fondo se vea en las costuras",
    },
    (LABEL, "Unlimited"): {"de_DE": "Unbegrenzt", "es": "Ilimitado"},
    (SENTENCE, "Fill the whole background"): {"de_DE": "Den ganzen Hintergrund füllen", "es": "Rellena todo el fondo"},
    (LABEL, "Clean Mips"): {"de_DE": "Saubere Mips", "es": "Mips limpios"},
    (
        SENTENCE,
        "Number of mip levels on which UV islands may not mix, for the checks. 1 level takes 2 texels between "
        "islands, 2 take 4, 3 take 8, and half as many to the border",
    ): {
        "de_DE": "Anzahl der Mip-Stufen, auf denen sich UV-Inseln nicht mischen dürfen, für die Prüfungen. 1 Stufe "
        "braucht 2 Texel zwischen Inseln, 2 brauchen 4, 3 brauchen 8, und halb so viele zum Bildrand",
        "es": "Cantidad de niveles mip en los que las islas UV no deben mezclarse, para las comprobaciones. 1 "
        "nivel requiere 2 texels entre islas, 2 requieren 4, 3 requieren 8, y la mitad hasta el límite de "
        "la imagen",
    },
    (LABEL, "Stacked UVs"): {"de_DE": "Gestapelte UVs", "es": "UV apiladas"},
    (
        SENTENCE,
        "Which part of the low mesh gets its own detail where several parts share texels. The others show the same",
    ): {
        "de_DE": "Welcher Teil des Low-Meshs seine eigenen Details bekommt, wo sich mehrere Teile Texel teilen. Die anderen "
        "zeigen dasselbe",
        "es": "Qué parte de la malla low recibe su propio detalle donde varias partes comparten texels. Las demás muestran "
        "lo mismo",
    },
    (LABEL, "First Part"): {"de_DE": "Erster Teil", "es": "Primera parte"},
    (
        SENTENCE,
        "The part whose faces come first in the mesh, as what was modeled before the copies of Mirror and Array",
    ): {
        "de_DE": "Der Teil, dessen Flächen im Mesh zuerst kommen, wie das Modellierte vor den Kopien von Spiegeln und Array",
        "es": "La parte cuyas caras están primero en la malla, como lo modelado antes de las copias de Simetría y Repetición",
    },
    (LABEL, "Last Part"): {"de_DE": "Letzter Teil", "es": "Última parte"},
    (SENTENCE, "The part whose faces come last in the mesh, as the last copy of a modifier"): {
        "de_DE": "Der Teil, dessen Flächen im Mesh zuletzt kommen, wie die letzte Kopie eines Modifikators",
        "es": "La parte cuyas caras están al final en la malla, como la última copia de un modificador",
    },
    (LABEL, "Modifiers"): {"de_DE": "Modifikatoren", "es": "Modificadores"},
    (SENTENCE, "Which settings of modifiers to use"): {
        "de_DE": "Welche Einstellungen der Modifikatoren verwendet werden",
        "es": "Qué opciones de los modificadores se usan",
    },
    (LABEL, "Render"): {"de_DE": "Rendern", "es": "Procesar"},
    (SENTENCE, "Levels and visibility as set for rendering"): {
        "de_DE": "Stufen und Sichtbarkeit wie für das Rendern eingestellt",
        "es": "Niveles y visibilidad definidos para el procesamiento",
    },
    (LABEL, "Viewport"): {"de_DE": "Ansichtsfenster", "es": "Vista"},
    (SENTENCE, "Levels and visibility as set for the viewport"): {
        "de_DE": "Stufen und Sichtbarkeit wie für das Ansichtsfenster eingestellt",
        "es": "Niveles y visibilidad definidos para la vista",
    },
    (LABEL, "Set Limit"): {"de_DE": "Grenze setzen", "es": "Definir límite"},
    (
        SENTENCE,
        "Set the distance between the high and the low surface above which a warning is shown. Without it, the check Far "
        "counts from 5 % of the low mesh's radius on, and warns of nothing that is deep",
    ): {
        "de_DE": "Den Abstand zwischen High-Poly- und Low-Poly-Oberfläche einstellen, ab dem gewarnt wird. Ohne ihn zählt die "
        "Prüfung Weit entfernt ab 5 % des Radius des Low-Poly-Meshes und warnt nicht vor dem, was nur tief ist",
        "es": "Define la distancia entre las superficies high poly y low poly a partir de la cual se muestra una advertencia. "
        "Sin ella, la comprobación Lejos cuenta desde el 5 % del radio de la malla low poly y no advierte de lo que solo es "
        "profundo",
    },
    (LABEL, "Limit"): {"de_DE": "Grenze", "es": "Límite"},
    (
        SENTENCE,
        "Distance between the high and the low surface above which the check Far counts texels. Where it is set, a warning "
        "names them",
    ): {
        "de_DE": "Abstand zwischen High-Poly- und Low-Poly-Oberfläche, ab dem die Prüfung Weit entfernt Texel zählt. Ist er "
        "eingestellt, nennt eine Warnung sie",
        "es": "Distancia entre las superficies high poly y low poly a partir de la cual la comprobación Lejos cuenta texels. "
        "Si está definida, una advertencia los nombra",
    },
    (LABEL, "Channels"): {"de_DE": "Kanäle", "es": "Canales"},
    (LABEL, "Red"): {"de_DE": "Rot", "es": "Rojo"},
    (LABEL, "Green"): {"de_DE": "Grün", "es": "Verde"},
    (LABEL, "Blue"): {"de_DE": "Blau", "es": "Azul"},
    (SENTENCE, "Axis of the normal that the red channel stores"): {
        "de_DE": "Achse der Normalen, die der rote Kanal speichert",
        "es": "Eje de la normal que almacena el canal rojo",
    },
    (SENTENCE, "Axis of the normal that the green channel stores: +Y for OpenGL, -Y for DirectX"): {
        "de_DE": "Achse der Normalen, die der grüne Kanal speichert: +Y für OpenGL, -Y für DirectX",
        "es": "Eje de la normal que almacena el canal verde: +Y para OpenGL, -Y para DirectX",
    },
    (SENTENCE, "Axis of the normal that the blue channel stores"): {
        "de_DE": "Achse der Normalen, die der blaue Kanal speichert",
        "es": "Eje de la normal que almacena el canal azul",
    },
    (SENTENCE, "The normal's X"): {"de_DE": "X der Normalen", "es": "X de la normal"},
    (SENTENCE, "The normal's X, inverted"): {"de_DE": "X der Normalen, invertiert", "es": "X de la normal, invertida"},
    (SENTENCE, "The normal's Y. In the green channel: Blender, Unity, Godot, glTF"): {
        "de_DE": "Y der Normalen. Im grünen Kanal: Blender, Unity, Godot, glTF",
        "es": "Y de la normal. En el canal verde: Blender, Unity, Godot, glTF",
    },
    (SENTENCE, "The normal's Y, inverted. In the green channel: Unreal, DirectX, CryEngine"): {
        "de_DE": "Y der Normalen, invertiert. Im grünen Kanal: Unreal, DirectX, CryEngine",
        "es": "Y de la normal, invertida. En el canal verde: Unreal, DirectX, CryEngine",
    },
    (SENTENCE, "The normal's Z"): {"de_DE": "Z der Normalen", "es": "Z de la normal"},
    (SENTENCE, "The normal's Z, inverted"): {"de_DE": "Z der Normalen, invertiert", "es": "Z de la normal, invertida"},
    (LABEL, "Presets"): {"de_DE": "Voreinstellungen", "es": "Preajustes"},
    (OPERATOR, "Use Preset"): {"de_DE": "Voreinstellung verwenden", "es": "Usar preajuste"},
    (SENTENCE, "Set channels, basis, depth, alpha and the names of maps as a program needs them"): {
        "de_DE": "Kanäle, Basis, Tiefe, Alpha und die Namen der Maps so setzen, wie ein Programm sie braucht",
        "es": "Define los canales, la base, la profundidad, el alfa y los nombres de los mapas como los necesita un programa",
    },
    (SENTENCE, "File of the preset"): {"de_DE": "Datei der Voreinstellung", "es": "Archivo del preajuste"},
    (OPERATOR, "Add Preset"): {"de_DE": "Voreinstellung hinzufügen", "es": "Adicionar preajuste"},
    (SENTENCE, "Save the channels, the basis, depth, alpha and the names of maps as a preset, or remove a preset"): {
        "de_DE": "Kanäle, Basis, Tiefe, Alpha und die Namen von Maps als Voreinstellung speichern oder eine Voreinstellung "
        "entfernen",
        "es": "Guarda los canales, la base, la profundidad, alfa y los nombres de los mapas como preajuste, o elimina un "
        "preajuste",
    },
}
