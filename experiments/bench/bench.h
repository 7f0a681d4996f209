// Palpate Bench: renderers, plug-ins and recorded traces on public or hidden cases, ranked.
#pragma once

#include <string>
#include <vector>

#include <palpate/result.h>
#include "experiments/bench/ranking.h"
#include "experiments/report/page.h"
#include "experiments/session/session.h"

namespace palpate::experiments {

/// Ours, and the rivals that are entered beside them.
inline constexpr const char* kUsualEntries =
    "cloud,cloud-smooth,heightfield,mls-proxy,mesh-godobject:mesh=advancing-front,sdf-godobject";

struct BenchArguments {
  std::string entries;  ///< renderers with options, and folders of traces, by commas; empty: kUsualEntries
  std::string seed;     ///< read_seed()
  std::string out;
  std::string save_cases;  ///< a folder for the cases' files: nothing is run
  std::string check;       ///< a bench.json whose numbers are made again
  std::string against;     ///< a bench.json of another seed: what is tuned to one of them
  bool quick = false;      ///< few points and frames
  int threads = 0;         ///< of preparation; 0: all
  bool json = false;
};

/// The page of a bench.json and of these tables.
[[nodiscard]] Page bench_page(const BenchDocument& document, const std::vector<Table>& tables);

/// Runs, writes bench.json and its page, prints the ranks. Exit status kExitFellShort: an entry did not
/// finish a case, or what was checked differs.
[[nodiscard]] Result<int> run_bench(const BenchArguments& arguments, Context& context);

}  // namespace palpate::experiments
