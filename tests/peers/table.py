"""Markdown tables of what run.py wrote: python table.py RESULTS > tables.md"""

import json
import pathlib
import sys

import numpy as np

HEADS = {"as_given": "as given", "refitted": "parameters fitted", "sindy": "SINDy", "symbolic": "symbolic regression",
         "gaussian_process": "Gaussian process", "network": "network", "ours": "ours"}
PEERS = ("sindy", "symbolic", "gaussian_process", "network")


def both(values):
    return "/".join(f"{v:.2f}" if v < 99.5 else f"{v:.0f}" for v in values)


def total(answer):
    return float(np.sqrt(np.mean(np.square(answer["clean_kpa"]))))


def concealed(result):
    """What is concealed, in a few words."""
    if not result["concealed"]:
        return {"nothing": "nothing", "parameters_moved": "nothing (parameters moved)"}.get(result["class"], result["class"])
    return " + ".join(f"{e['kind']} ({e['where']})" for e in result["concealed"])


def kept(answer):
    keeps = answer["chosen"]["keeps"]
    return keeps["positive"] or keeps["negative"]


def errors(results, which):
    lines = ["| case | concealed | " + " | ".join(HEADS.values()) + " |", "| --- " * (len(HEADS) + 2) + "|"]
    for r in results:
        cells = []
        for step in HEADS:
            answer = r["answers"].get(step)
            if answer is None:
                cells.append("")
            elif step in PEERS and not kept(answer):
                cells.append("–")
            else:
                cells.append(both(answer[which]))
        lines.append(f"| `{r['case']}` | {concealed(r)} | " + " | ".join(cells) + " |")
    return lines


def share(results):
    """Median share of the squared error of the refit that each takes away, where something is concealed and the refit
    is off by more than half the noise."""
    lines = ["| | cases | median share taken away | worse than the refit in |", "| --- | --- | --- | --- |"]
    off = [r for r in results if r["concealed"] and total(r["answers"]["refitted"]) > 0.5 * float(np.mean(r["noise_kpa"]))]
    for step in (*PEERS, "ours"):
        have = [r for r in off if step in r["answers"]]
        shares = [1.0 - (total(r["answers"][step]) / total(r["answers"]["refitted"])) ** 2 for r in have]
        every = [r for r in results if step in r["answers"]]
        worse = sum(total(r["answers"][step]) > 1.02 * total(r["answers"]["refitted"]) + 0.002 for r in every)
        if shares:
            lines.append(f"| {HEADS[step]} | {len(have)} | {100 * np.median(shares):.0f} % | {worse} of {len(every)} |")
    return lines


def shorten(text, most):
    return text if len(text) <= most else text[: most - 2].rsplit(" ", 1)[0] + " …"


def formulas(answer, most):
    """Formulas of what is kept, from their largest term on."""
    if answer is None:
        return ""
    if not kept(answer):
        return "nothing kept"
    chosen = answer["chosen"]
    terms = chosen["form"].get("terms")
    told = []
    for place, formula in chosen["formula"].items():
        if formula != "0":
            count = f" ({terms[('positive', 'negative').index(place)]} terms)" if terms else ""
            told.append(f"{place}{count}: `{shorten(formula, most)}`")
    return "; ".join(told)


def said(results):
    lines = ["| case | concealed | SINDy | symbolic regression | ours |", "| --- | --- | --- | --- | --- |"]
    for r in results:
        cells = [concealed(r), formulas(r["answers"].get("sindy"), 48), formulas(r["answers"].get("symbolic"), 70)]
        ours = r["answers"].get("ours")
        names = ", ".join(f"`{m['id']}` {m['where']}" for m in ours["mechanisms"]) if ours else ""
        rivals = ", ".join(f"`{name}`" for pair in ours["rivals"] for name in pair) if ours else ""
        verdict = ours["verdict"].replace("_", " ") if ours else ""
        cells.append(verdict + (f": {names}" if names else "") + (f"; not told apart: {rivals}" if rivals else ""))
        lines.append(f"| `{r['case']}` | " + " | ".join(c.replace("|", "¦") for c in cells) + " |")
    return lines


def main():
    results = [json.loads(f.read_text()) for f in sorted(pathlib.Path(sys.argv[1]).glob("*.json"))]
    for title, lines in (("Against the trace without noise", errors(results, "clean_kpa")),
                         ("Against the readings", errors(results, "noisy_kpa")), ("Shares", share(results)),
                         ("What they say", said(results))):
        print(f"## {title}\n\n" + "\n".join(lines) + "\n")
    apart = [r["answers"]["refitted"]["peers_plant_differs_kpa"] for r in results]
    print(f"Peers' plant against `trainer simulate`: at most {np.max(apart):.4f} kPa rms.")


if __name__ == "__main__":
    main()
