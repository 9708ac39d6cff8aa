"""Text tables as Excel, LabVIEW, MATLAB, pandas, R, Octave, numpy and instruments write them.

`READ` holds those that are read, `REFUSED` those that are doubtful.
"""

from __future__ import annotations

import csv
from typing import Any

import numpy as np
import pandas as pd

N = 60
GENERATOR = np.random.default_rng(11)
U = np.round(3.0 * GENERATOR.standard_normal(N), 6)
Y = np.round(np.convolve(U, [0.0, 0.5, 0.25])[:N] + 0.1, 6)
T = np.arange(N) / 200.0
FRAME = pd.DataFrame({"u": U, "y": Y})
TIMED = pd.DataFrame({"time": T, "u": U, "y": Y})


def rows(*columns, separator=",", decimal=".", end="\n", form="{:.6f}") -> str:
    lines = [
        separator.join(
            value if isinstance(value, str) else form.format(value).replace(".", decimal)
            for value in row
        )
        for row in zip(*columns, strict=True)
    ]
    return end.join(lines) + end


def german(header: str = "") -> str:
    return header + rows(T, U, Y, separator=";", decimal=",", end="\r\n")


def with_line(text: str, number: int, line: str, repeated: int = 1) -> str:
    lines = text.split("\n")
    lines[number - 1 : number - 1 + repeated] = [line] * repeated
    return "\n".join(lines)


def saved(write, **settings) -> str:
    """What numpy writes."""
    import io

    stream = io.StringIO()
    np.savetxt(stream, write, **settings)
    return stream.getvalue()


def texts(form: str, values) -> list[str]:
    return [form.format(value) for value in values]


NAMED = {"input": "u", "output": "y", "sampling_rate": 200.0}
STAMPED = {"input": "u", "output": "y", "time": "time"}
THIRD = {"input": 2, "output": 3, "sampling_rate": 200.0}
PLAIN = {"input": 1, "output": 2, "sampling_rate": 200.0}
NUMBERS = list(range(N))

LVM_GENERAL = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\n"
    "Decimal_Separator\t{mark}\nMulti_Headings\tNo\nX_Columns\t{columns}\nTime_Pref\tRelative\n"
    "Operator\tme\nDate\t2024/11/21\nTime\t10:00:00.1234567\n***End_of_Header***\t\n\t\n"
)
LVM_SEGMENT = (
    "Channels\t2\t\t\nSamples\t60\t60\t\nDate\t2024/11/21\t2024/11/21\t\n"
    "Time\t10:00:00.12\t10:00:00.12\t\nY_Unit_Label\tVolts\tVolts\t\nX_Dimension\tTime\tTime\t\n"
    "X0\t0.0000000000000000E+0\t0.0000000000000000E+0\t\nDelta_X\t0.005000\t0.005000\t\n"
    "***End_of_Header***\t\t\t\nX_Value\tu\ty\tComment\n"
)
LVM = LVM_GENERAL.format(mark=".", columns="One") + LVM_SEGMENT + rows(T, U, Y, separator="\t")
LVM_COMMA = (LVM_GENERAL.format(mark=",", columns="One") + LVM_SEGMENT).replace("0.0", "0,0")
LVM_COMMA += rows(T, U, Y, separator="\t", decimal=",")
LVM_NO_X = LVM_GENERAL.format(mark=".", columns="No") + LVM_SEGMENT
LVM_NO_X += rows([""] * N, U, Y, separator="\t")
OCTAVE = "# Created by Octave 7.3.0, Sun Nov 22 2026 <me@here>\n"
OCTAVE_MATRIX = "# name: {}\n# type: matrix\n# rows: 60\n# columns: 2\n"
PAIRS = rows(texts(" {}", U), texts("{}", Y), separator=" ")
MOTEC = (
    '"Format","MoTeC CSV File",,\n"Venue","Bench",,\n"Sample Rate","200.000","Hz",\n'
    '"Duration","0.300","s",\n\n\n"Time","u","y",\n"s","N","mm",\n\n\n'
)
PICOSCOPE = "Time;Channel A;Channel B\r\n(ms);(V);(mV)\r\n\r\n"
DIADEM = "Time;u;y\n[s];[Nm];[m/s²]\n"
DIADEM_TEXTS = "Time;u;y\ns;N;mm\nclock of the bench;drive, motor side;tip, laser\n"
TEKTRONIX = "".join(
    f"{left},{u:.6f},{y:.6f},\n"
    for left, u, y in zip(
        ["Record Length,60,", "Sample Interval,5e-3,", "Trigger Point,3,", *[",,"] * (N - 3)],
        U, Y, strict=True,
    )
)  # fmt: skip

READ: dict[str, tuple[str | bytes, dict[str, Any]]] = {
    # Excel
    "excel_utf8": (("\ufeffu,y\r\n" + rows(U, Y, end="\r\n")).encode(), NAMED),
    "excel_german": (german("time;u;y\r\n").encode("cp1252"), STAMPED),
    "excel_unicode_text": (
        ("time\tu\ty\r\n" + rows(T, U, Y, separator="\t", decimal=",", end="\r\n")).encode(
            "utf-16"
        ),
        STAMPED,
    ),
    "excel_sep_line": ("sep=;\r\n" + german("time;u;y\r\n"), STAMPED),
    "excel_quoted_sep_line": ('"sep=,"\ntime,u,y\n' + rows(T, U, Y), STAMPED),
    "excel_macintosh": ("u,y\r" + rows(U, Y, end="\r"), NAMED),
    "excel_line_break_in_heading": (
        'time,"Force\nu","Tip\ny"\n' + rows(T, U, Y),
        {"input": "Force u", "output": "Tip y", "time": "time"},
    ),
    "excel_quoted_headings": (
        'time,"force, N","tip, ""laser"""\n' + rows(T, U, Y),
        {"input": "force, N", "output": 'tip, "laser"', "time": "time"},
    ),
    "excel_padded_title": (";Bench;\n;;\ntime;u;y\n" + german(), STAMPED),
    "excel_empty_rows_below": (german("time;u;y\n") + ";;\r\n;;\r\n", STAMPED),
    "excel_two_empty_columns": (
        "u;y;;\n" + rows(U, Y, [""] * N, [""] * N, separator=";", decimal=","),
        NAMED,
    ),
    "excel_error_in_a_spare_column": (
        "u,y,note\n" + rows(U, Y, ["#N/A"] * N),
        NAMED,
    ),
    "excel_error_in_the_first_spare_column": (
        "note,u,y\n" + rows(["1.5", "#N/A", *["2.5"] * (N - 2)], U, Y),
        NAMED,
    ),
    "excel_german_dates_beside": (
        "when;u;y\n" + rows(["31.05.2024 12:00:00,5"] * N, U, Y, separator=";", decimal=","),
        NAMED,
    ),
    "excel_scientific": ("u;y\n" + rows(texts("{:.8E}", U), texts("{:.8E}", Y), separator=";")
        .replace(".", ","), NAMED),
    "dos_end_of_file": (rows(U, Y) + "\x1a", PLAIN),
    "doubled_line_ends": (rows(U, Y, end="\r\r\n").encode(), PLAIN),
    # LabVIEW
    "labview_lvm": (LVM, {"input": "u", "output": "y", "time": "X_Value"}),
    "labview_lvm_decimal_comma": (LVM_COMMA, {"input": "u", "output": "y", "time": "X_Value"}),
    "labview_lvm_no_x": (LVM_NO_X, NAMED | {"header_lines": 23}),
    "labview_spreadsheet": (rows(U, Y, separator="\t", end="\r\n"), PLAIN),
    "labview_spreadsheet_closed": (rows(U, Y, separator="\t", end="\t\r\n"), PLAIN),
    # MATLAB
    "matlab_writetable": (
        "Var1,Var2\n" + rows(texts("{:.15g}", U), texts("{:.15g}", Y)),
        {"input": "Var1", "output": "Var2", "sampling_rate": 200.0},
    ),
    "matlab_timetable_with_a_rate": (
        "Time,u,y\n" + rows(texts("{:g} sec", T), U, Y),
        NAMED,
    ),
    "matlab_save_ascii": (rows(texts("   {:.7e}", U), texts("{:.7e}", Y), separator="  "), PLAIN),
    # pandas
    "pandas_default": (FRAME.to_csv(), NAMED),
    "pandas_numbered_columns": (
        pd.DataFrame(np.column_stack([U, Y])).to_csv(),
        {"input": "0", "output": "1", "sampling_rate": 200.0},
    ),
    "pandas_numbered_columns_fixed": (
        pd.DataFrame(np.column_stack([U, Y])).to_csv(index=False, float_format="%.6f"),
        {"input": "0", "output": "1", "sampling_rate": 200.0},
    ),
    "pandas_german": (TIMED.to_csv(sep=";", decimal=",", index=False), STAMPED),
    "pandas_quoted": (TIMED.to_csv(quoting=csv.QUOTE_NONNUMERIC, index=False), STAMPED),
    "pandas_all_quoted": (TIMED.to_csv(quoting=csv.QUOTE_ALL, index=False), STAMPED),
    "pandas_dates": (
        FRAME.set_index(
            pd.date_range("2024-01-01", periods=N, freq="5ms", tz="Europe/Berlin", name="time")
        ).to_csv(date_format="%Y-%m-%dT%H:%M:%S.%f%z"),
        STAMPED,
    ),
    "pandas_missing_in_a_spare_column": (
        FRAME.assign(spare=np.where(np.arange(N) % 3, np.nan, 1.0)).to_csv(na_rep="NULL"),
        NAMED,
    ),
    # R
    "r_write_csv": ('"","u","y"\n' + rows(texts('"{}"', range(1, N + 1)), U, Y), NAMED),
    "r_write_csv2": (
        '"time";"u";"y"\n' + rows(T, U, Y, separator=";", decimal=","),
        STAMPED,
    ),
    "r_write_table": (
        '"u" "y"\n' + rows(texts('"{}"', range(1, N + 1)), U, Y, separator=" "),
        NAMED,
    ),
    "r_write_table_unquoted": (
        "u\ty\n" + rows(texts("{}", range(1, N + 1)), U, Y, separator="\t"),
        NAMED,
    ),
    "r_blank_in_a_heading": (
        '"drive force" "y"\n' + rows(U, Y, separator=" "),
        NAMED | {"input": "drive force"},
    ),
    # numpy, Octave
    "numpy_savetxt": (saved(np.column_stack([U, Y]), header="u y"), NAMED),
    "numpy_savetxt_names_and_units": (
        saved(np.column_stack([T, U, Y]), header="time u y\ns N mm", fmt="%.6f"),
        STAMPED,
    ),
    "octave_one_matrix": (OCTAVE + OCTAVE_MATRIX.format("d") + PAIRS, PLAIN),
    # Measuring programs
    "diadem_names_and_units": (
        DIADEM + rows(T, U, Y, separator=";", decimal=","),
        {"input": "u", "output": "y", "time": "Time"},
    ),
    "diadem_texts_with_header_lines": (
        DIADEM_TEXTS + rows(T, U, Y, separator=";", decimal=","),
        {"input": "u", "output": "y", "time": "Time", "header_lines": 3},
    ),
    "motec": (
        MOTEC + rows(texts('"{:.6f}"', T), texts('"{:.6f}"', U), texts('"{:.6f}"', Y)),
        {"input": "u", "output": "y", "time": "Time"},
    ),
    "picoscope_milliseconds": (
        PICOSCOPE + rows(1000 * T, U, Y, separator=";", decimal=",", end="\r\n"),
        {"input": "Channel A", "output": "Channel B", "time": "Time"},
    ),
    "keysight": (
        "x-axis,1,2\nsecond,Volt,Volt\n" + rows(texts("{:+.6E}", T), U, Y),
        {"input": "1", "output": "2", "time": "x-axis"},
    ),
    "saleae": (
        "Time [s],Channel 0,Channel 1\n" + rows(T, U, Y),
        {"input": "Channel 0", "output": "Channel 1", "time": "Time [s]"},
    ),
    "tektronix": (TEKTRONIX, {"input": 4, "output": 5, "sampling_rate": 200.0}),
    "arduino_millis": (
        "millis,u,y\n" + rows(texts("{:.0f}", 1000 * T), U, Y),
        {"input": "u", "output": "y", "time": "millis"},
    ),
    "heading_with_comments_below": ("u,y\n# made today\n" + rows(U, Y), NAMED),
    "trailing_comment": (rows(U, Y) + "# end of file, 60 samples\n", PLAIN),
    "plus_signs_and_bare_points": (rows(texts("{:+.6f}", U), texts("{:.6f}", Y)), PLAIN),
    "decimal_mark_stated": (
        "u;y\n" + rows(texts("{:.3f}", 1 + U.round(3) ** 2), Y, separator=";", decimal=",")
        .replace(".", ","),
        NAMED | {"decimal_mark": ","},
    ),
    "rows_of_overload_with_header_lines": (
        "u,y\n" + "OVLD,OVLD\n" * 4 + rows(U, Y),
        NAMED | {"header_lines": 5},
    ),
    "first_sample_0_1_with_header_lines": (
        "0,1\n" + rows(U, Y, form="{:.6g}"),
        PLAIN | {"header_lines": 1},
    ),
}  # fmt: skip

REFUSED: dict[str, tuple[str | bytes, dict[str, Any], str]] = {
    # Excel
    "excel_na": (with_line(rows(U, Y), 30, "#N/A,1.2"), PLAIN, 'line 30, column 1: "#N/A"'),
    "excel_na_in_the_first_row": ("u,y\n#N/A,1\n" + rows(U, Y), PLAIN, "line 2: the row"),
    "excel_division": (with_line(rows(U, Y), 30, "#DIV/0!,1"), PLAIN, "line 30, column 1"),
    "excel_narrow_column": (with_line(rows(U, Y), 30, "########,1.2"), PLAIN, "line 30, column 1"),
    "excel_thousands_point": (with_line(german(), 30, "0,1;12.345;0,3\r"), THIRD, '"12.345"'),
    "excel_thousands_points_in_whole_numbers": (
        rows(texts("{}", [999, "1.234"] * (N // 2)), texts("{}", NUMBERS), separator=";"),
        PLAIN,
        'set decimal_mark: "."',
    ),
    "excel_thousands_in_quotes": (
        with_line(rows(U, Y), 30, '"1,234.5",1.2'), PLAIN, 'line 30, column 1: "1,234.5"'),
    "excel_percent": (with_line(rows(U, Y), 30, "12%,1.2"), PLAIN, 'line 30, column 1: "12%"'),
    "excel_german_dates_as_time": (
        "time;u;y\n" + rows(["31.05.2024 12:00:00"] * N, U, Y, separator=";", decimal=","),
        STAMPED,
        "time is not later than the one before",
    ),
    "excel_minutes_as_time": (
        "time,u,y\n" + rows(texts("12:{:04.1f}", T), U, Y), STAMPED, "line 2, column 1"),
    "excel_formula": (with_line(rows(U, Y), 30, '="1.5",1.2'), PLAIN, "line 30, column 1"),
    "excel_empty_rows_between": (
        with_line("u,y\n" + rows(U, Y), 30, ",", 4), NAMED, 'input "u", sample 29: the value is'),
    "excel_empty_row_below_the_headings": ("u,y\n,\n" + rows(U, Y), NAMED, "line 2: the row"),
    "excel_truth": (rows(["TRUE", "FALSE"] * (N // 2), Y), PLAIN, "line 1, column 1"),
    # LabVIEW
    "labview_two_segments": (
        LVM + LVM_SEGMENT + rows(T, U, Y, separator="\t"),
        {"input": "u", "output": "y", "time": "X_Value"},
        "line 93: the row has 4 fields where the others have 3",
    ),
    "labview_lvm_no_x": (LVM_NO_X, NAMED, "set header_lines"),
    "labview_nan": (with_line(LVM, 40, "0.05\tNaN\t1.0", 4), NAMED, 'input "u", sample 17: '),
    # MATLAB
    "matlab_timetable": (
        "Time,u,y\n" + rows(texts("{:g} sec", T), U, Y),
        {"input": "u", "output": "y", "time": "Time"},
        'line 2, column 1: "0 sec"',
    ),
    "matlab_complex": (rows(texts("{}+1i", U), Y), PLAIN, "column 1"),
    # pandas
    "pandas_numbered_columns_without_index": (
        pd.DataFrame(np.column_stack([U, Y])).to_csv(index=False), PLAIN, 'line 1: the row "0,1"'),
    "pandas_index_as_input": (FRAME.to_csv(), PLAIN, "holds the row numbers 0 to 59"),
    "pandas_missing": (
        FRAME.assign(y=FRAME.y.where((FRAME.index < 7) | (FRAME.index > 10))).to_csv(index=False),
        NAMED,
        'output "y", sample 8: the value is missing',
    ),
    "pandas_null": (
        FRAME.assign(y=FRAME.y.where(FRAME.index != 7)).to_csv(index=False, na_rep="NULL"),
        NAMED,
        'line 9, column 2: "NULL"',
    ),
    "pandas_two_levels_of_columns": (
        pd.concat({"motor": FRAME}, axis=1).to_csv(index=False),
        PLAIN,
        "line 2: the row",
    ),
    "pandas_durations": (
        FRAME.set_index(pd.to_timedelta(T, unit="s").rename("time")).to_csv(),
        STAMPED,
        'line 2, column 1: "0 days 00:00:00',
    ),
    # R
    "r_na": (with_line("u,y\n" + rows(U, Y), 9, "NA,1"), NAMED, 'line 9, column 1: "NA"'),
    "r_na_in_the_first_row": ("u,y\nNA,NA\n" + rows(U, Y), PLAIN, "line 2: the row"),
    "r_row_names_as_input": (
        '"","u","y"\n' + rows(texts('"{}"', range(1, N + 1)), U, Y),
        PLAIN,
        "holds the row numbers 1 to 60",
    ),
    # numpy, Octave, gnuplot
    "numpy_complex": (rows(texts("({}+0j)", U), Y), PLAIN, "column 1"),
    "octave_two_matrices": (
        OCTAVE + (OCTAVE_MATRIX.format("a") + PAIRS) + (OCTAVE_MATRIX.format("b") + PAIRS),
        PLAIN,
        'line 66: the line "# name: b" stands between rows',
    ),
    "gnuplot_blocks": (rows(U, Y) + "\n\n" + rows(U, Y), PLAIN, "line 61: the line between rows"),
    # Instruments
    "overload_below_the_headings": (
        "u,y\n" + "OVLD,OVLD\n" * 20 + rows(U, Y), PLAIN, 'line 21: the row "OVLD,OVLD"'),
    "overload_in_the_first_row": ("u,y\nOVLD,OVLD\n" + rows(U, Y), PLAIN, "line 2: the row"),
    "overload_without_headings": ("OVLD,OVLD\n" + rows(U, Y), PLAIN, "line 1: the row"),
    "error_words_without_headings": ("OVLD,bad\n" + rows(U, Y), PLAIN, "line 1: the row"),
    "overload_in_one_channel": ("u,y\nOVLD,1.2\n" + rows(U, Y), PLAIN, "line 2: the row"),
    "overload_twice": (
        "u,y\nOVLD,1.2\nBAD,ERR\n" + rows(U, Y), PLAIN, "line 3: the row"),
    "dashes_for_missing": ("u,y\n--,--\n" + rows(U, Y), PLAIN, "line 2: the row"),
    "text_below_the_headings": ("u,y\nx\n" + rows(U, Y), NAMED, "line 2: the row"),
    "time_of_day_above": ("u,y\n12:00:00\n" + rows(U, Y), NAMED, "line 2: the row"),
    "spoilt_first_sample": ("1.5.2,0.5.1\n" + rows(U, Y), PLAIN, "line 1: the row"),
    "spoilt_first_field": ("1_5,x\n" + rows(U, Y), PLAIN, "line 1: the row"),
    "marked_number_below_the_headings": ("u,y\n%5\n" + rows(U, Y), NAMED, "line 2: the line"),
    "marked_last_sample_of_three": (
        rows(T, U, Y, separator="\t") + "//\t0.5\t1.5\n", PLAIN, "line 61: the line"),
    "marked_text_below_the_headings": ("u,y\n%5,x\n" + rows(U, Y), NAMED, "line 2: the line"),
    "one_overload_without_headings": ("OVLD\n" + rows(U, Y), PLAIN, "line 1: the row"),
    "one_nan_without_headings": ("NaN\n" + rows(U, Y), PLAIN, "line 1: the row"),
    "channel_numbers_as_headings": ("time,1,2\n" + rows(T, U, Y), THIRD, "line 1: the row"),
    "blank_in_a_field": (
        with_line(rows(U, Y, T, separator="\t"), 30, "1 5\t1\t"), PLAIN, 'line 30, column 1'),
    "short_first_sample": ("1.5\n" + rows(U, Y), PLAIN, "line 1: the row"),
    "three_rows_of_headings": (
        DIADEM_TEXTS + rows(T, U, Y, separator=";", decimal=","), THIRD, "header_lines"),
    "commented_sample": (
        with_line(rows(U, Y), 30, "!x,1.2"), PLAIN, 'line 30: the line "!x,1.2" stands between'),
    "percent_sample": (with_line(rows(U, Y), 30, "%5,1.2"), PLAIN, "line 30"),
    "slash_sample": (with_line(rows(U, Y), 30, "//,1.2"), PLAIN, "line 30"),
    "marked_first_sample": ("%5,1.2\n" + rows(U, Y), PLAIN, "line 1: the line"),
    "marked_last_sample": (rows(U, Y) + "#0.5,1.2\n", PLAIN, "line 61: the line"),
    "comment_between": (with_line(rows(U, Y), 30, "# valve open"), PLAIN, "line 30"),
    "blank_line_between": (with_line(rows(U, Y), 30, ""), PLAIN, "line 30: the line between"),
    "windows_nan": (with_line(rows(U, Y), 9, "1.#QNAN,1"), PLAIN, 'line 9, column 1: "1.#QNAN"'),
    "windows_infinity": (with_line(rows(U, Y), 9, "1.#INF,1"), PLAIN, "line 9, column 1"),
    "windows_ind": (with_line(rows(U, Y), 9, "-nan(ind),1"), PLAIN, "line 9, column 1"),
    "fortran_overflow": (with_line(rows(U, Y), 9, "******,1"), PLAIN, "line 9, column 1"),
    "fortran_exponent": (with_line(rows(U, Y), 9, "1.234-105,1"), PLAIN, "line 9, column 1"),
    "unicode_minus": (with_line(rows(U, Y), 9, "−1.5,1"), PLAIN, "line 9, column 1"),
    "hexadecimal": (with_line(rows(U, Y), 9, "0x1F,1"), PLAIN, "line 9, column 1"),
    "scpi_overload": (with_line(rows(U, Y), 9, "9.9E+37,1", 4), PLAIN, "sample 9: the value is 9."),
    "scpi_nan": (with_line(rows(U, Y), 9, "0.5,9.91E37", 4), PLAIN, "sample 9: the value is 9.91"),
    "swiss_thousands": (with_line(rows(U, Y), 9, "1'234.5,1"), PLAIN, "line 9, column 1"),
    "date_among_numbers": (with_line(rows(U, Y), 9, "2024-01-01,1"), PLAIN, "line 9, column 1"),
    "quote_not_closed": (with_line(rows(U, Y), 9, '"1.5,1'), PLAIN, "line 9"),
    "comma_blank_decimals": (
        "".join(f"1,{i + 20}, 3,{i + 30}\n" for i in range(N)), PLAIN, "both the separator"),
    "units_without_names": ("V,V\n" + rows(U, Y), PLAIN, "line 1: the row"),
}  # fmt: skip
