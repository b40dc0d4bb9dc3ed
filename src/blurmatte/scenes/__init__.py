"""Scene files, rendered scenes on disk with their truth, and scores of answers."""

from blurmatte.scenes.reading import read_shots as read_shots
from blurmatte.scenes.reading import scene_names as scene_names
from blurmatte.scenes.reading import scene_text as scene_text
from blurmatte.scenes.reading import scene_title as scene_title
from blurmatte.scenes.saving import archive_scenes as archive_scenes
from blurmatte.scenes.saving import save_archive as save_archive
from blurmatte.scenes.saving import save_shot as save_shot
from blurmatte.scenes.score import ProgramAnswer as ProgramAnswer
from blurmatte.scenes.score import Score as Score
from blurmatte.scenes.score import find_scenes as find_scenes
from blurmatte.scenes.score import mean_score as mean_score
from blurmatte.scenes.score import read_answer as read_answer
from blurmatte.scenes.score import read_truth as read_truth
from blurmatte.scenes.score import score as score
from blurmatte.scenes.score import score_table as score_table
