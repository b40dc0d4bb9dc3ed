"""Statistical constants and small estimators, each once."""

from blurmatte.statistics.chi_square import MEDIAN_3 as MEDIAN_3
from blurmatte.statistics.chi_square import QUANTILE_999_3 as QUANTILE_999_3
from blurmatte.statistics.chi_square import chi_square_quantile as chi_square_quantile
from blurmatte.statistics.noise_correlation import BLOCK_SIZES as BLOCK_SIZES
from blurmatte.statistics.noise_correlation import block_squares as block_squares
from blurmatte.statistics.noise_correlation import block_sums as block_sums
from blurmatte.statistics.noise_correlation import cell_means as cell_means
from blurmatte.statistics.noise_correlation import core_mean_square as core_mean_square
from blurmatte.statistics.noise_correlation import significant_inflation as significant_inflation
from blurmatte.statistics.noise_correlation import variance_inflation as variance_inflation
from blurmatte.statistics.robust_scale import MAD_TO_STD as MAD_TO_STD
from blurmatte.statistics.robust_scale import robust_std as robust_std
