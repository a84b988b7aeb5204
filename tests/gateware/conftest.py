import numpy as np
import pytest
from amaranth import Value
from amaranth.lib.wiring import Flow
from amaranth.sim import Simulator


@pytest.fixture
def simulate():
    """Run a component in Amaranth's own simulator.

    ``simulate(component, cycles, name={cycle: level, ...}, ...)``: an input has its level from
    clock edge ``cycle`` on; a plain number is its level throughout. Returns the outputs just after
    each edge, with the inputs of that edge still applied, as a dict of arrays; or, with ``before``,
    as each edge finds them.
    """

    def run(component, cycles, before=False, **inputs):
        outputs = {
            "__".join(map(str, path)): Value.cast(value)
            for path, member, value in component.signature.flatten(component)
            if member.flow is Flow.Out
        }
        seen = {name: np.zeros(cycles, np.int64) for name in outputs}

        async def bench(context):
            for cycle in range(cycles):
                for name, levels in inputs.items():
                    if not isinstance(levels, dict) and cycle == 0:
                        context.set(getattr(component, name), levels)
                    elif isinstance(levels, dict) and cycle in levels:
                        context.set(getattr(component, name), levels[cycle])
                if not before:
                    await context.tick()
                for name, value in outputs.items():
                    seen[name][cycle] = context.get(value)
                if before:
                    await context.tick()

        simulator = Simulator(component)
        simulator.add_clock(25e-9)
        simulator.add_testbench(bench)
        simulator.run()
        return seen

    return run
