#include "experiments/trade/tune.h"

#include <fmt/format.h>

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"

namespace palpate::experiments {
namespace {

void declare_tune(const Declaration& declare, TuneArguments& a) {
  a.sweep.budget_s = kTuneBudgetS;
  constexpr NumberRange kSeconds{1, 1e7}, kLimit{0.0, 1e15, true};
  declare.number(
      "--max-error", a.max_error, kLimit,
      "the cheapest setting whose error (95th percentile, percent of the true force) is at most this");
  declare.number("--max-frame-us", a.max_frame_us, kLimit,
                 "the most accurate setting of which 99.9 % of all frames take at most so many µs");
  declare.number("--max-bytes", a.max_bytes, kLimit,
                 "the most accurate setting that holds at most so many bytes, all told");
  declare_trade(declare, a.sweep);
  declare.number("--budget", a.sweep.budget_s, kSeconds,
                 fmt::format("seconds that measuring may take (default: {:g})", kTuneBudgetS));
}

}  // namespace

Subcommand tune_subcommand() {
  return subcommand(
      "tune", "the cheapest setting that is accurate enough, or the most accurate that is cheap enough",
      {"palpate tune sinusoid:points=10201 --max-error 5 --budget 60 --out out/tune",
       "palpate tune sinusoid:points=10201 --max-bytes 4e6 --renderers cloud,cloud-smooth --budget 60 --out "
       "out/small"},
      declare_tune, run_tune);
}

}  // namespace palpate::experiments
