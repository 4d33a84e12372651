# ruff: noqa: RUF001 - Chinese has punctuation of its own
"""`servolink doctor` speaks the language of the shell, from the texts of the studio.

Module: servolink.cli.boards.doctor.
"""

from __future__ import annotations

import pytest

from servolink.cli.boards.doctor import Speech, report_text
from servolink.cli.screen.output import Table
from servolink.doctor import Finding, Report

_ABSENT = "no serial port, HID or USB device here can be a board, and no virtual board is served"


@pytest.mark.parametrize(
    ("environment", "tag"),
    [
        ({}, "en"),
        ({"LANG": "C.UTF-8"}, "en"),
        ({"LANG": "de_DE.UTF-8"}, "en"),
        ({"LANG": "zh_TW.UTF-8"}, "zh-Hant"),
        ({"LANG": "zh_HK.UTF-8"}, "zh-Hant"),
        ({"LANG": "zh_CN.UTF-8"}, "zh-Hans"),
        ({"LANG": "zh_TW.UTF-8", "LC_MESSAGES": "zh_CN.UTF-8"}, "zh-Hans"),
        ({"LANG": "zh_TW.UTF-8", "LC_ALL": "C"}, "en"),
        ({"LANG": "zh_TW.UTF-8", "LC_ALL": ""}, "zh-Hant"),
    ],
)
def test_the_language_is_that_of_the_shell(environment: dict[str, str], tag: str) -> None:
    assert Speech(environment, "utf-8").tag == tag


def test_an_output_without_chinese_characters_gets_english() -> None:
    taiwan = {"LANG": "zh_TW.BIG5"}
    assert [Speech(taiwan, encoding).tag for encoding in ("big5", "ascii", "latin-1")] == ["zh-Hant", "en", "en"]


def test_messages_are_translated_line_by_line_with_their_values() -> None:
    chinese = Speech({"LANG": "zh_TW.UTF-8"}, "utf-8")
    assert chinese.said("log out and in again\nls") == "登出再登入\nls"
    assert chinese.said("close the program, or: kill 7") == "關閉那個程式，或：kill 7"
    assert chinese.said("project id none, little byte order, 0.5 ms") == "專案識別碼 無，位元組順序 little，0.5 毫秒"
    refused = "rfc2217://rex:1: the server refuses RFC 2217; if it only passes bytes, write tcp://rex:1"
    assert (
        chinese.said(refused)
        == "rfc2217://rex:1：序列埠伺服器拒絕 RFC 2217；如果它只是原樣轉送資料，請填寫 tcp://rex:1"
    )
    assert (
        chinese.said("or, if it speaks RFC 2217: write rfc2217:// in place of tcp://")
        == "如果它支援 RFC 2217，也可以把 tcp:// 改寫為 rfc2217://"
    )
    for text in ("", "servo 1: nobody knows", "the cable is red, and blue", "a: b"):
        assert chinese.said(text) == text
    assert Speech({}).said("log out and in again") == "log out and in again"


def test_a_report_is_whole_in_each_language() -> None:
    findings = [
        Finding("container", "servolink runs in a container (Docker)", "in English", "docker run ..."),
        Finding("absent", _ABSENT, "nobody has translated this", "switch the board on and try another cable"),
    ]
    report = Report([], ["serial:///dev/ttyS9"], findings=findings)

    def shown(language: str) -> list[object]:
        parts = report_text(report, {"LANG": language}, "utf-8")
        return [part.rows if isinstance(part, Table) else part for part in parts]

    assert shown("zh_TW.UTF-8") == [
        [("已檢查", "serial:///dev/ttyS9")],
        "",
        ("1. 容器 (container)", "bold"),
        [
            ("現象", "servolink 在容器中執行（Docker）"),
            ("原因", "容器只看得到啟動時交給它的裝置。"),
            ("處理方式", "docker run ..."),
        ],
        "",
        ("2. 沒有控制板 (absent)", "bold"),
        [
            ("現象", "這裡沒有可能是控制板的序列埠、HID 或 USB 裝置，也沒有虛擬控制板"),
            ("原因", "nobody has translated this"),
            ("處理方式", "打開控制板電源，換一條線再試"),
        ],
    ]
    assert ("observation", _ABSENT) in shown("C")[6]  # type: ignore[operator]
    assert [*report_text(Report([]), {"LANG": "zh_CN"}, "utf-8")][-1] == "一切正常"
