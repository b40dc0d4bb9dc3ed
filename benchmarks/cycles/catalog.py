"""Which scenes there are: kinds of objects and motions, places and lights, split into three parts.

A part (`learn`, `tune`, `sealed`) has kinds, rooms and cameras of its own: what is fitted on one part
is tested on objects, places and cameras that it has not seen. Everything follows from the name of a
scene, which seeds its random generator.

Points are meters, with the camera at the origin: x right, y up, looking along -z. Pictures have x
right, y down, and pixel centers at whole numbers.
"""

import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from math import pi

import numpy as np

SIZE = (480, 320)  # pixels
LARGE = 2  # times SIZE, for the scenes of one place in each part
FOCAL = 1.2  # of the picture's width: a horizontal field of view of 45 degrees
FLOOR = -0.85  # m: rooms.FLOOR
WALL_DEPTH = 4.0  # m: rooms.WALL_DEPTH
MOMENTS = 33  # poses in an exposure; linear in between
RADIUS_PX = (7.0, 34.0)  # range of the object's radius
LENGTH_RADII = (0.5, 12.0)  # range of the path's length
DEPTH = (1.7, 2.9)  # m, range of the object's distance
EARLY = (
    1 / 512
)  # of the exposure: Cycles reads its shutter from a table of 256 times, half a step early
MARGIN_PX = 8.0  # between the object and the border of the picture
POST_X = 0.0  # m, where the post crosses the axis
PARTS = ("learn", "tune", "sealed")

Array = np.ndarray


@dataclass(frozen=True)
class Place:
    """A room in one light, as one camera sees it: all its scenes share one plate.

    Parameters
    ----------
    room, light : str
        Names of `rooms.ROOMS` and `rooms.LIGHTS`.
    post : bool
        Whether a post stands in front.
    scale : int
        Of the picture, over `SIZE`.
    filter_width : float
        Of the pixel filter (Blackman-Harris), pixels.
    f_stop : float
        Of the lens; 0 for a pinhole. Where it is not 0, the camera focuses 2.2 m away.
    """

    room: str
    light: str
    post: bool = False
    scale: int = 1
    filter_width: float = 1.5
    f_stop: float = 0.0

    @property
    def name(self) -> str:
        """Of the plate's files."""
        return f"{self.room}-{self.light}{'-post' * self.post}{'-large' * (self.scale > 1)}"

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return SIZE[0] * self.scale, SIZE[1] * self.scale

    @property
    def focal(self) -> float:
        """Focal length in pixels."""
        return FOCAL * self.size[0]

    def project(self, points: Array) -> Array:
        """(n, 2) pixels of (n, 3) points."""
        x, y, z = points.T
        center = (np.array(self.size) - 1) / 2
        return center + self.focal * np.stack([x, -y], axis=-1) / -z[:, None]

    def outline(self, points: Array, radius: float) -> tuple[Array, Array]:
        """Outlines of spheres in the picture: ellipses that are longer away from the axis.

        Parameters
        ----------
        points : (n, 3) float
            Centers, meters.
        radius : float
            Meters.

        Returns
        -------
        (n, 2), (n,) float
            Middles of the ellipses, and radii of discs of the same area, pixels.
        """
        x, y, z = points.T
        squared = z**2 - radius**2
        middle = (np.array(self.size) - 1) / 2
        xy = middle + self.focal * np.stack([x, -y], axis=-1) * (-z / squared)[:, None]
        distant = (points**2).sum(axis=-1) - radius**2
        return xy, self.focal * radius * distant**0.25 / squared**0.75

    def lift(self, pixels: Array, depth: Array) -> Array:
        """(n, 3) points at (n, 2) pixels and (n,) distances from the camera's plane."""
        center = (np.array(self.size) - 1) / 2
        x, y = ((pixels - center) * depth[:, None] / self.focal).T
        return np.stack([x, -y, -depth], axis=-1)


@dataclass(frozen=True)
class Mover:
    """An object and its poses at `MOMENTS` equal steps of the exposure.

    Parameters
    ----------
    shape : str
        A name of `objects.MAKERS`.
    radius : float
        Meters.
    poses : tuple of (float, …)
        x, y, z in meters and three Euler angles in radians, for each moment.
    seed : int
        Of its shape and paint.
    """

    shape: str
    radius: float
    poses: tuple[tuple[float, ...], ...]
    seed: int


@dataclass(frozen=True)
class CyclesScene:
    """Everything that the renderer needs for one picture."""

    name: str
    part: str
    kind: str
    place: Place
    movers: tuple[Mover, ...]
    rolling_shutter: float  # part of the exposure in which a row is open; 0: all rows together
    seed: int
    round: bool  # a ball, whose path and radius are defined in the picture

    @property
    def path(self) -> Array:
        """(MOMENTS, 2) pixels of the middle of the first object's outline, as if it were a sphere."""
        path = self.place.outline(self._points, self.movers[0].radius)[0]
        return path - EARLY * np.gradient(path, TIME, axis=0)

    @property
    def radius_px(self) -> float:
        """That of a disc with the outline's area, at the middle of the exposure, as of a sphere."""
        return float(self.place.outline(self._points, self.movers[0].radius)[1][MOMENTS // 2])

    @property
    def _points(self) -> Array:
        return np.array(self.movers[0].poses)[:, :3]

    def mapping(self) -> dict[str, object]:
        """For JSON; with what the renderer would have to compute otherwise."""
        extra = {"plate": self.place.name, "size": self.place.size, "focal": self.place.focal}
        truth = {"path": self.path.tolist(), "radius_px": self.radius_px}
        place = asdict(self.place) | {"focal_ratio": FOCAL}
        return asdict(self) | extra | truth | {"place": place}


@dataclass(frozen=True)
class Kind:
    """A kind of object and motion.

    Parameters
    ----------
    part : str
        The part that it belongs to.
    shapes : tuple of str
        Names of `objects.MAKERS`; one of them is drawn.
    motion : callable
        (place, radius in pixels, generator) → (n, 3) points.
    turn : float
        Most that it turns during the exposure, radians.
    radii : (float, float)
        Range of its radius, pixels.
    post : bool
        Behind a post.
    second : bool
        Two objects whose paths cross.
    """

    part: str
    shapes: tuple[str, ...]
    motion: Callable[[Place, float, np.random.Generator], Array]
    turn: float = 0.0
    radii: tuple[float, float] = RADIUS_PX
    post: bool = False
    second: bool = False

    @property
    def round(self) -> bool:
        """Whether all its shapes are balls of one outline."""
        return set(self.shapes) <= BALLS


BALLS = {
    "matte",
    "white",
    "glossy",
    "stripes",
    "patches",
    "dark",
    "glowing",
    "translucent",
    "smoke",
}
TIME = np.linspace(0, 1, MOMENTS)


def _segment(place: Place, radius: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Middle and half of a path that stays in the picture, pixels."""
    length = radius * np.exp(rng.uniform(*np.log(LENGTH_RADII)))
    angle = rng.uniform(0, 2 * pi)
    half = length / 2 * np.array([np.cos(angle), np.sin(angle)])
    room = np.array(place.size) / 2 - radius - MARGIN_PX * place.scale
    half *= min(1.0, *(0.9 * room / np.maximum(np.abs(half), 1e-9)))
    spare = np.maximum(room - np.abs(half), 0)
    return np.array(place.size) / 2 + rng.uniform(-spare, spare), half


def _bent(
    place: Place, radius: float, rng: np.random.Generator, bend: tuple[float, float]
) -> Array:
    """A parabola in the picture, `bend` of half its chord high, at one depth."""
    middle, half = _segment(place, radius, rng)
    across = rng.choice([-1, 1]) * rng.uniform(*bend) * np.array([-half[1], half[0]])
    s = 2 * TIME - 1
    pixels = middle + np.outer(s, half) + np.outer((1 - s**2) / 2, across)
    return place.lift(pixels, np.full(MOMENTS, rng.uniform(*DEPTH)))


def straight(place: Place, radius: float, rng: np.random.Generator) -> Array:
    """A straight path at one depth."""
    return _bent(place, radius, rng, (0, 0))


def sideways(place: Place, radius: float, rng: np.random.Generator) -> Array:
    """Across the picture, four radii or more: something upright in front hides a part."""
    x, y = rng.uniform(2, 5), rng.uniform(-1.2, 1.2)
    pixels = np.array(place.size) / 2 + np.outer(2 * TIME - 1, [x * radius, y * radius])
    pixels += [0, rng.uniform(-0.15, 0.15) * place.size[1]]
    return place.lift(pixels, np.full(MOMENTS, rng.uniform(*DEPTH)))


def arc(place: Place, radius: float, rng: np.random.Generator) -> Array:
    """A bent path, as of something thrown or swung."""
    return _bent(place, radius, rng, (0.25, 0.9))


def slow(place: Place, radius: float, rng: np.random.Generator) -> Array:
    """Half a radius to two: alpha reaches 1."""
    middle, half = _segment(place, radius, rng)
    half *= radius * rng.uniform(0.5, 2.0) / max(2 * np.hypot(*half), 1e-9)
    pixels = middle + np.outer(2 * TIME - 1, half)
    return place.lift(pixels, np.full(MOMENTS, rng.uniform(*DEPTH)))


def approach(place: Place, radius: float, rng: np.random.Generator) -> Array:
    """Coming nearer or going away: the radius changes by 10 to 30 %."""
    middle, half = _segment(place, radius, rng)
    near, far = 1, rng.uniform(1.1, 1.3)
    depth = rng.uniform(1.7, 2.4) * np.interp(TIME, [0, 1], rng.permutation([near, far]))
    return place.lift(middle + np.outer(2 * TIME - 1, half), depth)


def leave(place: Place, radius: float, rng: np.random.Generator) -> Array:
    """Out of the picture, or into it, across a side border."""
    side = rng.choice([-1, 1])
    x = place.size[0] / 2 + side * place.size[0] / 2
    inward = np.array([-side, rng.uniform(-0.6, 0.6)]) * radius * rng.uniform(2.5, 7)
    start = np.array(
        [x + side * rng.uniform(0, 1.5) * radius, place.size[1] * rng.uniform(0.3, 0.7)]
    )
    t = TIME if rng.uniform() < 0.5 else 1 - TIME
    return place.lift(start + np.outer(t, inward), np.full(MOMENTS, rng.uniform(*DEPTH)))


def bounce(place: Place, radius: float, rng: np.random.Generator) -> Array:
    """Down, and up again from something that is not seen."""
    middle, half = _segment(place, radius, rng)
    half = half * [1, 0.4]
    at, height = rng.uniform(0.3, 0.7), radius * rng.uniform(1.5, 4)
    away = np.where(at > TIME, (at - TIME) / at, rng.uniform(0.6, 0.95) * (TIME - at) / (1 - at))
    low = min(middle[1] + height / 2, place.size[1] - radius - MARGIN_PX)
    pixels = np.stack([middle[0] + (2 * TIME - 1) * half[0], low - height * away], axis=-1)
    return place.lift(pixels, np.full(MOMENTS, rng.uniform(*DEPTH)))


def roll(place: Place, radius: float, rng: np.random.Generator) -> Array:
    """On the floor, with its contact shadow."""
    depth = rng.uniform(2.9, 3.4)
    meters = radius * depth / place.focal
    half = radius * rng.uniform(1, 5)
    x = place.size[0] / 2 + rng.uniform(-0.2, 0.2) * place.size[0] + (2 * TIME - 1) * half
    points = place.lift(np.stack([x, 0 * x], axis=-1), np.full(MOMENTS, depth))
    points[:, 1] = FLOOR + meters
    return points


def near_wall(place: Place, radius: float, rng: np.random.Generator) -> Array:
    """A straight path one to three radii before the wall: its shadow is in the picture."""
    middle, half = _segment(place, radius, rng)
    depth = WALL_DEPTH / (1 + radius * rng.uniform(1.2, 3) / place.focal)
    return place.lift(middle + np.outer(2 * TIME - 1, half), np.full(MOMENTS, depth))


def pendulum(place: Place, radius: float, rng: np.random.Generator) -> Array:
    """An arc about a point above, faster in the middle."""
    middle, half = _segment(place, radius, rng)
    length = max(2 * np.hypot(*half), radius) * rng.uniform(0.7, 1.5)
    reach = min(np.hypot(*half) / length, 0.9)
    angle = reach * np.sin(np.interp(TIME, [0, 1], np.sort(rng.uniform(-pi / 2, pi / 2, 2))))
    pixels = middle + length * np.stack([np.sin(angle), np.cos(angle) - 1], axis=-1)
    return place.lift(pixels, np.full(MOMENTS, rng.uniform(*DEPTH)))


KINDS = {
    # learn
    "matte ball": Kind("learn", ("matte",), straight),
    "glossy ball": Kind("learn", ("glossy",), straight, turn=1.0),
    "textured ball": Kind("learn", ("patches",), straight, turn=1.5),
    "thrown ball": Kind("learn", ("matte", "glossy"), arc),
    "slow ball": Kind("learn", ("matte",), slow),
    "white ball": Kind("learn", ("white",), straight),
    "ball leaving the picture": Kind("learn", ("matte",), leave),
    "ball behind a post": Kind("learn", ("matte",), sideways, post=True, radii=(12, 34)),
    "ball near a wall": Kind("learn", ("matte",), near_wall),
    "two crossing balls": Kind("learn", ("matte",), straight, second=True, radii=(10, 26)),
    "ellipsoid": Kind("learn", ("ellipsoid",), straight, turn=1.0, radii=(12, 36)),
    "cube": Kind("learn", ("cube",), straight, turn=1.2, radii=(14, 40)),
    "sheet": Kind("learn", ("sheet",), straight, radii=(14, 40)),
    "stick": Kind("learn", ("stick",), straight, turn=0.0, radii=(20, 50)),
    "head": Kind("learn", ("head",), straight, turn=0.6, radii=(18, 44)),
    "drop": Kind("learn", ("drop",), straight, radii=(10, 30)),
    # tune
    "striped ball": Kind("tune", ("stripes",), straight, turn=1.5),
    "bouncing ball": Kind("tune", ("matte",), bounce),
    "ball coming nearer": Kind("tune", ("matte",), approach),
    "see-through ball": Kind("tune", ("translucent",), straight),
    "gray or black ball": Kind("tune", ("dark",), straight),
    "ring": Kind("tune", ("ring",), straight, turn=0.8, radii=(14, 40)),
    "turning sheet": Kind("tune", ("sheet",), straight, turn=1.5, radii=(14, 40)),
    "cloth": Kind("tune", ("cloth", "plain_cloth"), straight, turn=0.4, radii=(18, 44)),
    # sealed
    "rolling ball": Kind("sealed", ("matte", "patches"), roll, turn=1.5, radii=(10, 24)),
    "ball on a string": Kind("sealed", ("matte", "glossy"), pendulum),
    "glowing ball": Kind("sealed", ("glowing",), arc),
    "smoke ball": Kind("sealed", ("smoke",), straight),
    "bottle": Kind("sealed", ("bottle",), straight, turn=1.2, radii=(22, 48)),
    "shuttlecock": Kind("sealed", ("shuttle",), arc, turn=0.8, radii=(12, 34)),
    "hammer": Kind("sealed", ("hammer",), arc, turn=1.2, radii=(24, 50)),
    "turning stick": Kind("sealed", ("stick",), straight, turn=1.5, radii=(20, 50)),
    "star": Kind("sealed", ("star",), straight, turn=0.8, radii=(16, 44)),
}

PLACES = {
    "learn": (
        Place("gray_room", "lamp"),
        Place("gray_room", "two_lamps", filter_width=2.0),
        Place("photo_astronaut", "window"),
        Place("photo_coffee", "lamp", filter_width=1.2),
        Place("lawn", "sun"),
        Place("gray_room", "window", scale=LARGE),
    ),
    "tune": (
        Place("painted_room", "window"),
        Place("painted_room", "two_lamps", f_stop=2.8),
        Place("photo_chelsea", "lamp"),
        Place("brick_yard", "sun", filter_width=1.2),
        Place("brick_yard", "overcast", filter_width=2.0),
        Place("painted_room", "lamp", scale=LARGE),
    ),
    "sealed": (
        Place("tiled_room", "lamp", filter_width=1.3),
        Place("shelf", "window"),
        Place("photo_rocket", "two_lamps", filter_width=1.8),
        Place("court", "overcast", f_stop=2.8),
        Place("dunes", "sun"),
        Place("tiled_room", "window", scale=LARGE),
    ),
}  # the last place of each part is that of its large pictures; the court is a hall open to one side

SCENES_PER_KIND = {"learn": 13, "tune": 12, "sealed": 12}
ROLLING_SHARE = 0.1  # of the scenes that have a rolling shutter
ROLLING_SHUTTER = 0.6  # part of the exposure in which one row is open


def scenes(parts: tuple[str, ...] = PARTS) -> Iterator[CyclesScene]:
    """All scenes of some parts: first one of each kind, then the second of each kind, and so on."""
    for part in parts:
        kinds = [name for name, kind in KINDS.items() if kind.part == part]
        for number in range(SCENES_PER_KIND[part]):
            for kind in kinds:
                yield scene(kind, number)


def scene(kind_name: str, number: int) -> CyclesScene:
    """One scene of a kind."""
    kind = KINDS[kind_name]
    name = f"{kind_name.replace(' ', '_')}_{number:02}"
    seed = zlib.crc32(name.encode())
    rng = np.random.default_rng(seed)
    *places, large = PLACES[kind.part]
    if kind.motion is near_wall:
        places = [place for place in places if place.room != "lawn"]  # it has no wall
    last = number == SCENES_PER_KIND[kind.part] - 1
    place = large if last else places[(number + list(KINDS).index(kind_name)) % len(places)]
    if kind.post:
        place = Place(place.room, place.light, True, place.scale, place.filter_width, place.f_stop)
    radius = place.scale * np.exp(rng.uniform(*np.log(kind.radii)))
    movers = [_mover(kind, place, radius, rng)]
    if kind.second:
        movers.append(_crossing(movers[0], place, radius * rng.uniform(0.7, 1.3), rng))
    rolling = ROLLING_SHUTTER if rng.uniform() < ROLLING_SHARE else 0.0
    round_ = kind.round and not kind.second
    return CyclesScene(name, kind.part, kind_name, place, tuple(movers), rolling, seed, round_)


def _mover(kind: Kind, place: Place, radius: float, rng: np.random.Generator) -> Mover:
    shape = str(rng.choice(kind.shapes))
    points = kind.motion(place, radius, rng)
    if kind.post:  # the path's middle is near the post
        points[:, 0] += POST_X - points[:, 0].mean() + 0.02
    start = (
        rng.uniform(-pi, pi, 3) if kind.turn or shape in ("sheet", "stick", "drop") else np.zeros(3)
    )
    if shape in ("sheet", "star"):
        start = np.array([*rng.uniform(-0.6, 0.6, 2), start[2]])  # seen from the front
    turn = kind.turn * rng.uniform(-1, 1, 3)
    if shape == "drop":  # along its path
        ahead = points[-1] - points[0]
        start, turn = np.array([0, 0, np.arctan2(ahead[1], ahead[0])]), np.zeros(3)
    angles = start + np.outer(TIME, turn)
    meters = radius * -points[MOMENTS // 2, 2] / place.focal
    return _posed(shape, meters, points, angles, rng)


def _crossing(first: Mover, place: Place, radius: float, rng: np.random.Generator) -> Mover:
    """A second ball that goes across the middle of the first one's path, in front or behind."""
    path = place.project(np.array(first.poses)[:, :3])
    along = path[-1] - path[0]
    turn = rng.uniform(0.35, 0.65) * pi * rng.choice([-1, 1])
    c, s = np.cos(turn), np.sin(turn)
    half = np.array([[c, -s], [s, c]]) @ along / 2 * rng.uniform(0.7, 1.3)
    pixels = path[MOMENTS // 2] + np.outer(2 * TIME - 1, half)
    depth = -first.poses[0][2] * rng.choice([0.9, 1.1])
    points = place.lift(pixels, np.full(MOMENTS, depth))
    return _posed("matte", radius * depth / place.focal, points, np.zeros((MOMENTS, 3)), rng)


def _posed(
    shape: str, meters: float, points: Array, angles: Array, rng: np.random.Generator
) -> Mover:
    poses = tuple(tuple(row) for row in np.hstack([points, angles]).tolist())
    return Mover(shape, float(meters), poses, int(rng.integers(2**31)))
