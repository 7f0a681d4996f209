// A confidence interval: the bounds within which a repeated measurement would lie.
//
// First:
//   if (const auto& in = accuracy.force_rms_percent_interval)
//     std::printf("95 %% between %.2f and %.2f %%\n", in->low, in->high);
#pragma once

namespace palpate {

/// Holds 95 % of the resampled numbers.
struct Interval {
  double low = 0.0, high = 0.0;
};

}  // namespace palpate
