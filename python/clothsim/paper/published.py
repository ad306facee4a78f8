"""Results of Kim et al. in our words, for the tables to stand beside."""

from clothsim.typing import Response

CITATION = "Kim et al., Real-time collision response between cloth and sphere object in Unity"

METHODS: dict[int, tuple[Response, str]] = {
    1: ("reflect", "method 1: reflect the velocity (eq 7)"),
    2: ("ray", "method 2: ray back to the surface, then reflect (eq 8-12)"),
}

VARIANTS = {
    "as printed": "exactly as printed: the sphere's own velocity is ignored and every point found "
    "inside is reflected, also one that is already leaving",
    "corrected": "clothsim's default: velocity relative to the sphere, and only approaching points are reflected",
}

CLAIMS = {
    "1": "Table 3, frames 150, 500 and 800: the cloth's faces are penetrated with method 1 in all "
    "three and with method 2 in none.",
    "2": "Table 4, frames 200, 1300 and 3100 in the text (the printed table is headed 150, 500 "
    "and 800): the first, second and third contact. Frame 200, seen from the back: the edge folds "
    "with method 1 and wraps the sphere with method 2. Frames 1300 and 3100: the sphere penetrates "
    "the cloth with method 1, because the points are too slow to be moved out; not with method 2.",
    "3": "Figure 9, mean of every 200 frames, 10 runs: method 2 somewhat slower than method 1, "
    "both above 350 frames/s (GTX 1070).",
    "4": "Figure 10: method 2 on the GPU is 60 % faster than on the CPU (GTX 1070 against "
    "i5-4460), and its first measurement is slower because buffers are made in it.",
    "5": "Names as its limits that a fast sphere can pass between two steps and that method 1 "
    "penetrates slow cloth; gives no numbers for either.",
}

FRAMES_PER_SECOND = 350
