"""Every command: its file, what it is for, and an example."""

from jaxsim.cli.command import Command

COMMANDS = {
    "frames": Command(
        "frames:Frames",
        "any log of a LiDAR as polar frames: pcap, bag, MCAP, PCD, OSI, CARLA ...",
        "jaxsim frames recording.pcap --out measured",
    ),
    "prepare": Command(
        "prepare:Prepare",
        "make a data set's training pairs once and keep them",
        "jaxsim prepare synthetic --train 0-159 --eval 160-199 --out pairs",
    ),
    "train": Command(
        "train:run", "train an intensity network, a detector or depth completion; resumes", "jaxsim train synthetic"
    ),
    "join": Command(
        "join:Join",
        "one run of several that differ in their seed: the mean of their networks",
        "jaxsim join runs/first runs/second runs/third --out runs/joined",
    ),
    "grain": Command(
        "grain:LearnGrain", "learn how cells scatter together, for simulate --draws", "jaxsim grain runs/kitti_drives"
    ),
    "eval": Command(
        "eval:Evaluation",
        "score a trained run, two folders of frames, a detector's results; compare networks",
        "jaxsim eval runs/demo",
    ),
    "simulate": Command(
        "simulate:Simulate", "frames, clouds, pictures of a learned sensor", "jaxsim simulate runs/demo --out simulated"
    ),
    "export": Command(
        "export:Export",
        "a data set as a KITTI object tree, which detectors train on",
        "jaxsim export --data.kind synthetic --frames 0-199 --validation 160-199 --out tree",
    ),
    "detect": Command(
        "detect:Detect",
        "find objects in a folder of clouds",
        "jaxsim detect runs/voxel_rcnn_small --clouds tree/training/velodyne --out detected",
    ),
    "real2sim2real": Command(
        "real2sim2real:run",
        "the paper's loop: from real drives to detectors that train on simulated clouds",
        "jaxsim real2sim2real --config real2sim2real",
    ),
    "discover": Command(
        "discover:Discover",
        "name the effect that a simulation lacks",
        "jaxsim discover --measured measured --simulated simulated/polar --out answer",
    ),
    "engines": Command(
        "engines:Engines",
        "what discover found, in the parameters of CARLA, Isaac Sim, RGL, Gazebo, HELIOS++",
        "jaxsim engines answer/sensor.json --for carla",
    ),
    "watch": Command(
        "watch:Watch", "how a sensor changes from day to day", "jaxsim watch monday --days tuesday wednesday"
    ),
    "effects": Command("effects:Effects", "the catalogue of sensor effects", "jaxsim effects beam_gain"),
    "convert": Command(
        "convert:Convert",
        "published weights to files that jaxsim reads, a network to ONNX or StableHLO",
        "jaxsim convert vgg19 vgg19-dcbb9e9d.pth --out vgg19.npz",
    ),
    "completion": Command(
        "completion:Completion", "a script with which a shell completes these words", "jaxsim completion bash"
    ),
    "doctor": Command("doctor:Doctor", "versions, devices, cache and a sample run, for bug reports", "jaxsim doctor"),
}
MODES = {
    "effects new": Command(
        "effects:NewEffect", "a file of an effect of one's own to begin with", "jaxsim effects new rain_on_lens"
    ),
    "effects check": Command(
        "effects:CheckEffect", "what is wrong with such a file, what it looks like", "jaxsim effects check my.py"
    ),
    "eval generation": Command(
        "eval_generation:Generation",
        "two folders of frames or clouds",
        "jaxsim eval generation --simulated simulated/polar --measured measured --out scores",
    ),
    "eval detection": Command(
        "eval_detection:Detection",
        "a detector's KITTI result files",
        "jaxsim eval detection --detections detected/results --labels tree/training/label_2",
    ),
    "eval ablation": Command(
        "ablation:run",
        "networks of different inputs in one table",
        "jaxsim eval ablation --train ablation --out runs/ablation",
    ),
}
"""Commands of two words; any other second word is an effect's name, or a run's folder."""
