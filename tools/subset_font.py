"""Cut a font down to what pictures need: `subset_font.py SOURCE TARGET`.

Keeps Latin-1 and a few signs, gives the digits the width of each other (the font's feature
``tnum``, so that readings do not jump from frame to frame), and drops hints and layout tables.
The fonts of `drm_env/src/render/fonts` were made with it from the files
``inter-latin-400-normal.woff`` and ``inter-latin-600-normal.woff`` of the npm package
``@fontsource/inter`` 5.3.0. Needs fonttools, which comes with matplotlib.
"""

from __future__ import annotations

import sys

from fontTools import subset
from fontTools.ttLib import TTFont

SIGNS = "–—‘’“”•…−×±°²³·µ"
KEPT = [*range(0x20, 0x7F), *range(0xA0, 0x100), *map(ord, SIGNS)]


def main() -> None:
    """Read the source, write the target."""
    source, target = sys.argv[1:]
    font = TTFont(source)
    glyphs = set(font.getGlyphOrder())
    for table in font["cmap"].tables:
        for code in range(ord("0"), ord("9") + 1):
            fixed = f"{table.cmap.get(code)}.tf"
            if fixed in glyphs:
                table.cmap[code] = fixed
    options = subset.Options(layout_features=[], hinting=False, name_IDs=[0, 1, 2, 4, 13, 14])
    options.drop_tables += ["GSUB", "GPOS", "GDEF"]
    cutter = subset.Subsetter(options)
    cutter.populate(unicodes=KEPT)
    cutter.subset(font)
    font.flavor = None
    font.save(target)


if __name__ == "__main__":
    main()
