"""Colors and lengths of sheets."""

# sRGB codes
GROUND = 24, 25, 28
BRIGHT = 236, 236, 232  # text, paths
DIM = 160, 162, 166  # secondary text
NEUTRAL = 72, 73, 76  # where a color is unknown
WARNING = 255, 150, 90
UNKNOWN = 236, 64, 190  # light that is clipped or not known
STREAK = 255, 196, 60  # its box, and error ellipses
OTHER = 120, 190, 255  # other boxes, and the path between frames
HEAT = (18, 22, 48), (30, 92, 130), (70, 176, 150), (240, 228, 120)

# Pixels of a sheet
WIDTH = 1800
MARGIN = 40
CONTENT_WIDTH = WIDTH - 2 * MARGIN
GAP = 28  # between columns and rows
MAX_PICTURE_HEIGHT = 720  # of a whole picture
MAX_GRID_HEIGHT = 1320  # of all panels of a grid
TITLE_SIZE = 21  # of letters
BODY_SIZE = 17  # of letters
LINE_HEIGHT = 24  # of body text
