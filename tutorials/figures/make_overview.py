"""README's picture, put together from pictures of the tutorials.

python tutorials/figures/make_overview.py
"""

from pathlib import Path

from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont

HERE = Path(__file__).parent
WIDE, TALL, TITLE, GAP = 700, 390, 46, 20  # pixels of a tile, of its title, between tiles
TILES = (  # title, picture, rows of boxes in it
    ("A T1 scan becomes labels and a mesh", "scan.png", [[(517, 100, 916, 540), (517, 667, 916, 1107)]]),
    ("A blade opens a cleft: strain", "head.png", [[(655, 60, 1350, 715)]]),
    (
        "Pressure under the blade (mmHg), three protocols",
        "pressure.png",
        [
            [(80, 15, 720, 52)],
            [(42, 72, 100, 482), (530, 72, 1350, 482)],
            [(0, 480, 58, 481), (530, 732, 1350, 802)],
        ],
    ),
    ("Waves become stiffness: truth and inversion (kPa)", "stiffness.png", [[(0, 0, 298, 338), (622, 0, 956, 338)]]),
)


def tile(
    title: str, file: str, rows: list[list[tuple[int, int, int, int]]], font: ImageFont.FreeTypeFont
) -> Image.Image:
    """Parts of a picture, row by row, under a title."""
    picture, made = Image.open(HERE / file).convert("RGB"), Image.new("RGB", (WIDE, TITLE + TALL), "white")
    ImageDraw.Draw(made).text((0, 4), title, "black", font)
    wide = max(sum(right - left for left, _, right, _ in row) for row in rows)
    scale = min((WIDE - 4) / wide, TALL / sum(row[-1][3] - row[-1][1] for row in rows))
    y = TITLE
    for row in rows:
        x = 0
        for left, top, right, bottom in row:
            size = round((right - left) * scale), max(1, round((bottom - top) * scale))
            made.paste(picture.crop((left, top, right, bottom)).resize(size, Image.Resampling.LANCZOS), (x, y))
            x += size[0] + 4
        y += size[1]
    return made


font = ImageFont.truetype(font_manager.findfont("DejaVu Sans"), 26)
sheet = Image.new("RGB", (2 * WIDE + GAP, 2 * (TITLE + TALL) + GAP), "white")
for i, each in enumerate(TILES):
    sheet.paste(tile(*each, font), (i % 2 * (WIDE + GAP), i // 2 * (TITLE + TALL + GAP)))
sheet.quantize(192).save(HERE / "overview.png", optimize=True)
