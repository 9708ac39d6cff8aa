"""The public interface: what a name of ``evopem`` is, for its import and for type checkers."""

from evopem.config.constraints import Constraints as Constraints
from evopem.config.constraints import FixedPole as FixedPole
from evopem.config.constraints import Prior as Prior
from evopem.config.settings import ScoringWindow as ScoringWindow
from evopem.config.settings import SearchSettings as SearchSettings
from evopem.errors import InputError as InputError
from evopem.estimation.delays import estimate_delays as estimate_delays
from evopem.estimation.model_record import load_model as load  # noqa: F401
from evopem.estimation.polynomial_estimate import PolynomialEstimate as PolynomialEstimate
from evopem.estimation.state_space.local_estimates import StateSpaceEstimate as StateSpaceEstimate
from evopem.exports.c_code import export_c as export_c
from evopem.exports.fmu import export_fmu as export_fmu
from evopem.models.continuous import ContinuousModel as ContinuousModel
from evopem.models.orders import Orders as Orders
from evopem.models.polynomial import PolynomialModel as PolynomialModel
from evopem.models.state_space import StateSpaceModel as StateSpaceModel
from evopem.models.varying import VaryingModel as VaryingModel
from evopem.notebook.estimate import estimate as estimate
from evopem.notebook.identify import estimate_varying as estimate_varying
from evopem.notebook.identify import identify as identify
from evopem.notebook.identify import read_results as read_results
from evopem.notebook.results import Results as Results
from evopem.notebook.results import VaryingResults as VaryingResults
from evopem.notebook.state_space import estimates_of_orders as estimates_of_orders
from evopem.notebook.state_space import fit_responses as fit_responses
from evopem.results.damage_index import damage_index as damage_index
from evopem.signals.readers.frequency_responses import FrequencyResponses as FrequencyResponses
from evopem.signals.recording import Recording as Recording
from evopem.validation.mode_evidence import ModeTable as ModeTable
from evopem.validation.mode_evidence import mode_table as mode_table
from evopem.version import __version__ as __version__
