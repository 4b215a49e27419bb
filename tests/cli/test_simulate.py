from jaxsim.cli.simulate import speed


def test_the_simulations_speed_leaves_out_compilation_and_all_other_work():
    assert speed([30.0, 1.0, 3.0], 8, total_s=100.0).startswith("simulation alone 4.00 frames/s")
    assert "100.0 s in all" in speed([30.0, 1.0, 3.0], 8, total_s=100.0)


def test_one_batch_tells_no_speed():
    assert "frames/s" not in speed([30.0], 8, total_s=100.0)
