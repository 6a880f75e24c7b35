"""Map from the files to the paper's equations that they implement: README.md prints it, test_docstrings.py checks it.

    python -m tests.equation_map

writes the table into README.md, between its markers.
"""

from pathlib import Path

README = Path(__file__).parent.parent / "README.md"
BEGIN, END = "<!-- equations: from tests/equation_map.py -->\n", "<!-- end of equations -->"

# Module -> the equations that its docstrings name, and its contents; in the order of the paper.
EQUATIONS = {
    "mechanics.plant": ("(1), (2), (11)", "actuator torques in, accelerations and constraint forces out"),
    "mechanics.disturbance": ("(1)", "disturbances d: torques, a force on the object"),
    "mechanics.robot_dynamics": ("(5), (9)", "inertia and bias forces of one robot"),
    "mechanics.robot_kinematics": ("(6)-(9)", "chained form zeta, body rates, wheels, the arm's tip"),
    "mechanics.constraints": ("(10)", "residual phi, Jacobian J, Jdot u, row by row"),
    "mechanics.arc_contact": ("(10)", "the contact's row on the paper's arc"),
    "mechanics.level_contact": ("(10)", "the same on any other surface"),
    "mechanics.partitioning": ("(10), (40)", "map L from independent to all velocities, multipliers lambda"),
    "mechanics.constrained_kinematics": ("(10)", "the constrained motion at one state"),
    "mechanics.constrained_dynamics": ("(9), (11)", "coupled dynamics, reduced inertia"),
    "control.reference": ("(6), (12), (13)", "desired motion and force"),
    "control.path_motion": ("(8)", "desired motion beside any path"),
    "control.backstepping": ("(12)-(15)", "reference velocity z, errors s, filter eta"),
    "control.chain": ("(12)-(15), (31), (32)", "the same for chains of any length n_v"),
    "control.motion": ("(8), (12), (13), (15), (17)-(19)", "sigma, nu and the law U1 + U2"),
    "control.force": ("(17)", "force feed-forward and feedback lambda_h"),
    "control.adaptive": ("(19)-(24)", "robust term U2 and the adapted bounds chat"),
    "control.filtered_error": ("(15), (17), (18)", "filtered error sigma, and what laws on it share"),
    "control.model_based": ("(17), (18)", "the law for a system that is certain"),
    "control.robust_fixed": ("(18), (19)", "the robust term with bounds that are given"),
    "control.robust_adaptive": ("(18)-(24)", "the paper's controller: its state and command"),
    "loop.force_loop": ("(17)", "the force loop at one instant"),
    "loop.closed_loop": ("(11)-(24)", "all of it as one vector field"),
    "kinds.robust_adaptive": ("(12)-(15), (17)-(24)", "gains of the paper's controller"),
    "proof.terms": ("(30)-(40)", "the terms of the proof of Theorem 3.1"),
    "proof.steps": ("(34)-(37), (39), (40)", "both sides of the proof's steps, Assumption 3.2"),
    "proof.margins": ("(40)", "the steps' margins while a rollout is traced"),
    "proof.lyapunov": ("(31), (40)", "the Lyapunov function and its bound along a run"),
    "plotting.motion": ("(6)", "figures 3, 4, 5, 7 and 8"),
    "plotting.control": ("(15), (18), (20)-(24)", "figures 6 and 9, sigma, chat"),
    "plotting.force": ("(9)", "figure 10, multipliers, residual"),
}


def table() -> str:
    """The map in Markdown."""
    head = "| equations | file in `coopmm_jax` | contents |\n| --- | --- | --- |\n"
    rows = ((numbers, f"{name.replace('.', '/')}.py", contents) for name, (numbers, contents) in EQUATIONS.items())
    return head + "".join(f"| {numbers} | `{file}` | {contents} |\n" for numbers, file, contents in rows)


def written(text: str) -> str:
    """A README with the table between its markers."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}{table()}{END}{after}"


if __name__ == "__main__":
    README.write_text(written(README.read_text(encoding="utf-8")), encoding="utf-8")
