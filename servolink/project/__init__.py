"""Content of a board as a project: file, checks, edits, figure, and the transfer to and from a board."""

from __future__ import annotations

from servolink.project.adjust import rename_record, rename_servo, scale_project
from servolink.project.blocks import Blocks
from servolink.project.build import build_project, extend_project, refuse_new_errors
from servolink.project.figure import BodyFields, Feet, Figure, Joint, Shape, View
from servolink.project.fix import fix_project
from servolink.project.merge import CopiedMotions, merge_projects
from servolink.project.mirror import Mirror, mirror_by_captions, mirror_project
from servolink.project.model import UNFINISHED, Project, name_of, without_neutral
from servolink.project.naming import Named, id_or_caption
from servolink.project.preflight_checks import preflight, preflight_run, uncheckable
from servolink.project.project_file import ProjectFile, load_project, save_project
from servolink.project.record_lookup import (
    dependency_order,
    durations,
    macro_seconds,
    with_caption,
    with_id,
)
from servolink.project.single_record import (
    add_from,
    add_record,
    project_of,
    remove_records,
    replace_from,
    replace_record,
)
from servolink.project.speed import RecordRun
from servolink.project.summary import caption_of, described
from servolink.project.teaching import PoseRecorder
from servolink.project.transfer.backups import BackupStore
from servolink.project.transfer.import_plan import compare, plan_project
from servolink.project.transfer.importing import apply_project, backup_for, roll_back
from servolink.project.transfer.journal import Journal, JournalPhase
from servolink.project.transfer.pinned import PinnedConnection
from servolink.project.transfer.read import export_project
from servolink.project.transfer.results import ApplyResult, Change, Memory, Phase, Plan, Progress, ProgressCallback
from servolink.project.validate import Diagnostic, duplicates, validate_project

__all__ = [
    # project and its file
    "Project",
    "ProjectFile",
    "UNFINISHED",
    "load_project",
    "save_project",
    "without_neutral",
    # checks
    "Diagnostic",
    "duplicates",
    "fix_project",
    "preflight",
    "preflight_run",
    "uncheckable",
    "caption_of",
    "described",
    "validate_project",
    # edits
    "CopiedMotions",
    "Mirror",
    "PoseRecorder",
    "add_from",
    "add_record",
    "build_project",
    "extend_project",
    "merge_projects",
    "mirror_by_captions",
    "mirror_project",
    "project_of",
    "refuse_new_errors",
    "remove_records",
    "rename_record",
    "rename_servo",
    "replace_from",
    "replace_record",
    "scale_project",
    # records by id and caption
    "Named",
    "dependency_order",
    "durations",
    "id_or_caption",
    "macro_seconds",
    "name_of",
    "with_caption",
    "with_id",
    # motion of a record
    "RecordRun",
    # figure and blocks
    "Blocks",
    "BodyFields",
    "Feet",
    "Figure",
    "Joint",
    "Shape",
    "View",
    # transfer
    "ApplyResult",
    "BackupStore",
    "Change",
    "Journal",
    "JournalPhase",
    "Memory",
    "Phase",
    "PinnedConnection",
    "Plan",
    "Progress",
    "ProgressCallback",
    "apply_project",
    "backup_for",
    "compare",
    "export_project",
    "plan_project",
    "roll_back",
]
