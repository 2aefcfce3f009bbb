"""Tables of docs/speed.md, and of the time that explain and the page take."""

from __future__ import annotations

from results import load, percent, table


def kernel_speed() -> str:
    """Time of one step against C and the peers."""
    speed = load("kernel_speed")
    time = lambda side: f"{side['median']:.2f} ({side['quartiles'][0]:.2f} to {side['quartiles'][1]:.2f})"  # noqa: E731
    rows = []
    for name, work in speed["work"].items():
        peers = [time(work["peers"]), f"{work['faster_than_peers']:.1f}×"] if "peers" in work else ["", ""]
        rows.append([name, time(work["ours"]), time(work["c"]), f"{work['over_c']:.1f}×", *peers])
    rows.append(["IMU sample, whole chain", time(speed["chain"]), "", "", "", ""])
    header = ["µs of processor time, median (quartiles)", "ours", "C", "ours over C", "filterpy and statsmodels",
              "ours is faster by"]  # fmt: skip
    return table(header, rows)


def replay_speed() -> str:
    """Speed of replay."""
    speed = load("replay_speed")
    return table(
        ["replay", "asked", "measured"],
        [
            [f"{speed['duration']:g} s, {speed['messages']} messages, reading and writing included", "≥ 600×",
             f"{speed['realtime_factor']:.0f}× real time"],
            ["the whole process, start of Python included", "", f"{speed['realtime_factor_whole_process']:.0f}×"],
        ],
    )  # fmt: skip


def live_load() -> str:
    """The live nodes under load, and what they cost when they do less."""
    rows = []
    for name, run in load("live_load")["runs"].items():
        latency, load_average = run["latency_ms"], run["load_average_before_and_after"]
        count = sum(run["published"].values())
        per_message = 1e6 * run["cpu_share"] * run["duration_published"] / count
        rows.append(
            [name, f"{run['duration']:g} s", f"{run['lost']} of {count}",
             " / ".join(f"{latency[p]:.2f}" for p in ("p50", "p99", "p99.9")), f"{100 * run['cpu_share']:.0f} %",
             f"{per_message:.0f}", f"{load_average[0]:.1f}, {load_average[1]:.1f}"]
        )  # fmt: skip
    header = ["nodes do", "for", "messages lost", "latency p50 / p99 / p99.9 [ms]", "of one core", "µs per message",
              "load of the machine before, after"]  # fmt: skip
    return table(header, rows)


def explain() -> str:
    """First sentences of logs with one thing wrong each."""
    found = load("explain")
    rows = [
        [log["case"], "yes" if log["right"] else "no", log["sentence"], f"{log['elapsed']:.0f} s",
         f"{log['processor']:.0f} s"]
        for log in found["logs"]
    ]  # fmt: skip
    rows.append(["all", f"{found['right']} of {len(rows)}", "", "", ""])
    wrong = f"what is wrong, {found['duration']:g} s of flight"
    return table([wrong, "right", "said first", "time", "processor time"], rows)


def workbench() -> str:
    """The page of a long flight in a browser."""
    w = load("workbench")
    seconds, milliseconds = lambda value: f"{value:.1f} s", lambda value: f"{1000 * value:.0f} ms"
    return table(
        [f"{w['duration']:g} s of flight, {w['points']} measured coefficients", "asked", "median", "worst"],
        [
            ["page opened by a new browser, all six axes drawn", "< 3 s", seconds(w["interactive"]),
             seconds(w["interactive_worst"])],
            ["zoom to 10 s, all axes with every point", "", milliseconds(w["zoom"]), milliseconds(w["zoom_worst"])],
            ["a term added: reconstruction, fit, comparison", "", seconds(w["addition"]["work"]), ""],
            ["and after it, until all axes are drawn", "",
             milliseconds(w["addition"]["drawn"] - w["addition"]["work"]), ""],
            ["server ready after", "", seconds(w["server_ready"]), ""],
            ["main thread of the tab while nothing happens", "", percent(w["idle_main_thread"]), ""],
            ["JavaScript heap of the tab", "", f"{w['heap_mb']:.0f} MB", ""],
            ["file of `report`", "< 10 MB", f"{w['report_mb']:.1f} MB", ""],
            ["load of the machine while measuring", "", f"{w['load_average']:.1f} on {w['cores']} cores", ""],
        ],
    )  # fmt: skip


TABLES = {
    "kernel_speed": kernel_speed,
    "replay_speed": replay_speed,
    "live_load": live_load,
    "explain": explain,
    "workbench": workbench,
}
