"""What tests of detection are made of."""

from jaxsim.metrics.detection import evaluate, read_detections, read_truth
from jaxsim.metrics.detection.files import frames_with_results

CAR = "Car 0.00 0 0.00 {left:.2f} 100.00 {right:.2f} {bottom:.2f} 1.50 1.60 3.90 {x:.2f} 1.60 20.00 0.00"


def car(place, *, kind="Car", height=60.0, truncated=0.0, occluded=0, x=None, alpha=0.0, score=None, shift=0.0):
    """A line of a file: cars stand 6 m and 90 px apart; `shift` moves one by a part of its length, in 3D and image."""
    left = 90.0 * place + 80 * shift
    columns = CAR.format(
        left=left, right=left + 80, bottom=100 + height, x=6.0 * place + 3.9 * shift if x is None else x
    ).split()
    columns[:4] = kind, f"{truncated}", f"{occluded}", f"{alpha}"
    return " ".join(columns + ([] if score is None else [f"{score}"]))


def scores(tmp_path, *frames, rules="official", measure="precision"):
    """Scores of frames, each (labels, detections), by (difficulty, metric) at Car's 0.7."""
    for folder, k in (("label", 0), ("found", 1)):
        (tmp_path / folder).mkdir(exist_ok=True)
        for n, frame in enumerate(frames):
            (tmp_path / folder / f"{n:06d}.txt").write_text("\n".join(frame[k]) + "\n")
    names = frames_with_results(tmp_path / "label")
    curves = evaluate(
        read_truth(tmp_path / "label", names),
        read_detections(tmp_path / "found", names),
        rules=rules,
        classes=("Car",),
    )
    return {(c.difficulty, c.metric): c for c in curves if c.overlap_set == "0.7"}


def many(labels, found, copies=50):
    return [(labels, found)] * copies
