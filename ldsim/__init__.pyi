from ldsim.dynamics.simulate import simulate as simulate
from ldsim.export.notebook import view as view
from ldsim.run import Run as Run
from ldsim.runtime.batch import BatchedSimulator as BatchedSimulator
from ldsim.simulator import Simulator as Simulator
from ldsim.simulator import load as load

HOMES: dict[str, str]
__version__: str
