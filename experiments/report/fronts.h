// Fronts: what accuracy costs, a point for each setting.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "experiments/report/figures.h"

namespace palpate::experiments {

/// One setting, with the ends of its intervals.
struct FrontPoint {
  std::string setting;
  std::string group;  ///< its renderer: points of one group have one colour
  double cost = 0.0, cost_low = 0.0, cost_high = 0.0;
  double error = 0.0, error_low = 0.0, error_high = 0.0;
  bool on_front = false;
};

/// On a logarithmic axis nothing is 0: what is below is drawn here, at the left edge, and the caption says
/// so.
inline constexpr double kLeastErrorPercent = 1e-4;

/// Error across, cost upwards, both logarithmic. Points on the front are numbered by their error, in the
/// order of numbered(); the others stand without a number. The line joins the cheapest of each error.
[[nodiscard]] Chart front_chart(const std::string& name, const std::string& title, const std::string& cost,
                                std::vector<FrontPoint> points);
/// Kinds of renderers, in the order of the legend.
enum class Kind : std::uint8_t { kPoints, kMesh, kField, kHeights };
struct KindPoint {
  Kind kind = Kind::kPoints;
  FrontPoint point;
};
/// Error across, cost upwards, both logarithmic: each kind has a colour, a shape and a front of its own, and
/// what another one of its kind beats is pale. The renderers on the fronts stand beside their most accurate
/// points, where there is room.
[[nodiscard]] Chart kinds_chart(const std::string& name, const std::string& title, const std::string& cost,
                                const std::vector<KindPoint>& points);
/// Kinds of one study's renderers: mean time of all frames against force error, or against preparation where
/// no forces are compared.
[[nodiscard]] Chart trade_chart(const std::string& name, const metrics::ResultDocument& document);
/// The points on the front by their error, the most accurate first: number 1 is the first.
[[nodiscard]] std::vector<FrontPoint> numbered(std::vector<FrontPoint> points);

}  // namespace palpate::experiments
