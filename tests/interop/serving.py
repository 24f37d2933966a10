"""Serves a model with complex data, an objective and a model that may fail: serving.py PORT."""

import sys
from pathlib import Path


def main(port):
    import umbridge
    from optimiser_models import Exponential, reduced_of, waves

    from ngbrain.interop.umbridge import model

    harmonic, risky = waves(), reduced_of(Exponential(), -0.5)
    served = [
        model(harmonic, harmonic.theta, "waves"),
        model(risky, risky.unknowns.start, "objective"),
        model(Exponential(), [0.0] * 8, "real"),
    ]
    umbridge.serve_models(served, port)


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))
    main(int(sys.argv[1]))
