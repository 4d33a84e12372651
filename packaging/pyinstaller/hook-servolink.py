"""Hook of PyInstaller: data files, and the modules that are imported by their names."""

from __future__ import annotations

from PyInstaller.utils.hooks import collect_data_files, collect_submodules, copy_metadata

datas = [*collect_data_files("servolink"), *copy_metadata("servolink")]
hiddenimports = collect_submodules("servolink", filter=lambda name: name != "servolink.__pyinstaller")
