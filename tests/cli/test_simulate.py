from jaxsim.cli.simulate import told
from jaxsim.simulate.folder import Speed


def speed(batches_s):
    return Speed(simulated=20, already=0, batch=8, batches_s=batches_s, total_s=100.0)


def test_the_simulations_speed_leaves_out_compilation_and_all_other_work():
    assert told(speed((30.0, 1.0, 3.0))).startswith("simulation alone 4.00 frames/s")
    assert "100.0 s in all" in told(speed((30.0, 1.0, 3.0)))


def test_one_batch_tells_no_speed():
    assert "frames/s" not in told(speed((30.0,)))
