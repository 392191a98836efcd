"""The benchmarks: one module each, run by `./tcs bench NAME`.

A module has `add_arguments(parser)` for its own options and `run(arguments)`, which returns a list of
{name, value, unit, beside, ratio}: what was measured, beside what, and how many times it; where it is a number of a sample,
`error` is by how much it scatters.
"""

BENCHMARKS = {
    "bag": "reading an hour of joint states, beside other readers",
    "recorder": "the recorder node at 1 kHz and five topics",
    "simulate": "the offline axis, beside scipy's solve_ivp",
    "live": "what the page of a running graph costs it, at 1 kHz with two pages open",
    "services": "every service of every node called while messages flow",
    "faults": "real time under faults: limits kept, every fault named, the run resumed",
    "canopen": "the loop in real time on a CANopen drive, simulated on a virtual bus",
    "ros2_control": "the loop in real time on a robot under ros2_control, simulated beside it",
    "axes": "one axis commissioned in real time while another moves",
    "realtime": "latency and jitter of the loop in real time, beside a bare publisher and subscriber",
    "graph": "ticks per second of the node graph, beside a bare chain of messages",
    "cost": "the identification's cost, beside NumPy",
    "accuracy": "identified parameters, beside truth and Cramer-Rao bound",
    "identify": "optimisers on the same cost",
    "hardware": "every friction law on every recording of real hardware",
    "hostile": "files drawn to hurt, beside the limits of time and memory",
    "fleet": "many recordings on two workers beside one, the engine beside the work",
    "compensated": "tracking for having been diagnosed, beside an axis without the effects",
    "compensated_prediction": "predicted gain of compensation, beside the gain then measured on the true axis",
    "monitor": "the watch for changes: false alarms in a day, time until a change is told, cost of a tick",
    "fleet_year": "changes in years of stored results: false ones, and planted ones within their errors",
    "ablation": "what each rule of the diagnosis is needed for: every world again without the rules that decided in it",
    "concealed": "diagnosis of concealed effects, beside an oracle and baselines",
}
