// Every rate with every delay: the largest stable stiffness as tables and charts.
#pragma once

#include <string>
#include <vector>

#include "experiments/report/figures.h"
#include "experiments/stability/stability.h"

namespace palpate::experiments {

/// "13.2", "over 73.9", "none".
[[nodiscard]] std::string limit_text(const StabilityPoint& point);

/// One table for each renderer: rows are hand, control and delay, columns the rates. Below the truth's the
/// linear loop of a plane. None where nothing was crossed.
[[nodiscard]] std::vector<Table> cross_tables(const StabilityDocument& document);

/// One chart for each renderer and hand: a line for each control (its colour) and delay (its dashes).
[[nodiscard]] std::vector<Chart> cross_charts(const StabilityDocument& document);

}  // namespace palpate::experiments
