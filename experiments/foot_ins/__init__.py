"""The foot's trajectory against motion capture, footprints and gaitmap: stride lengths, what each part does, speed."""

PARTS = ("strides", "closures", "ablation", "pivot", "speed", "simulated")
