"""The command that proposes where something moved: find."""

from __future__ import annotations

from typing import Annotated

import blurmatte as bm
from blurmatte.cli.app import AsJson, command
from blurmatte.cli.console import about, answer, argument, waiting
from blurmatte.cli.rows import expanded
from blurmatte.cli.selection import GUESSED, CameraReading, PlateOptions, matching_of


@command("find throw.png --plate none", "find throw.png --plate empty_room.png")
def find(
    image: Annotated[str, argument("IMAGE", "The picture with the object.")],
    plate: PlateOptions,
    reading: CameraReading,
    as_json: AsJson = False,
) -> None:
    """Propose values of --region: where something moved.

    Without a plate: where something is that a smooth scene around it does not explain.
    """
    path = expanded([image])[0]
    with about(path), waiting("finding regions"):
        C = reading.read(path)
        if plate.plate == GUESSED:
            boxes = bm.background.regions_that_stand_out(C)
        else:
            B = bm.match_plate(reading.read(plate.plate), C, matching_of(plate.match))
            boxes = [streak.box for streak in bm.find_streaks(C, B)]
        if not boxes:
            raise bm.errors.MotionError(
                "nothing stands out from a smooth scene; mark where the object may have been with "
                "--region of solve"
                if plate.plate == GUESSED
                else "nothing moved: no region differs from the plate by more than noise"
            )
    lines = [f"--region {','.join(map(str, box))}" for box in boxes]
    answer(as_json, {"regions": [list(map(int, box)) for box in boxes]}, lines)
