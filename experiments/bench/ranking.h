// The bench's document and ranking, for others to check.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/clock.h>
#include <palpate/result.h>
#include "experiments/bench/cases.h"
#include "experiments/driver/json_document.h"
#include "experiments/report/page.h"
#include "experiments/report/tables.h"
#include "experiments/session/session.h"
#include "toolkit/metrics/result_json.h"

namespace palpate::experiments {

inline constexpr const char* kBenchSchema = "palpate-bench/1";
inline constexpr const char* kBenchFile = "bench.json";

/// A participant.
struct BenchEntry {
  std::string label;
  std::string kind;     ///< "renderer" of the registry, plug-ins among them, or "traces"
  std::string request;  ///< as on the command line; of traces the folder's name alone
};

/// One entry on one case. A number that was not measured is empty.
struct BenchRow {
  std::string entry, name, shape;  ///< name: of the case
  std::string reason;              ///< why it did not finish; empty: it did
  std::string trace_hash;
  std::optional<double> caught, lost, kicks, force_rms_percent, direction_mean_deg, force_peak_excess_percent;
  std::optional<double> frame_mean_us, frame_p999_us, prepare_ms, bytes_per_point;
};

struct BenchDocument {
  metrics::DocumentHead head;
  bool quick = false;
  int threads = 0;  ///< of preparation
  std::string seed, seed_sha256;
  std::vector<CaseInputs> cases;
  std::vector<BenchEntry> entries;
  std::vector<BenchRow> rows;
};

/// A number of every row and how cases are put together.
struct BenchMeasure {
  std::string_view key, title, group;  ///< group: "right", "fast", "ready" or "small"
  std::optional<double> BenchRow::*value;
  bool sum;  ///< over cases; else the median
};
[[nodiscard]] std::span<const BenchMeasure> bench_measures();

/// One entry by one measure; less is better in all.
struct BenchStanding {
  std::optional<double> value;
  std::optional<Interval> interval;  ///< 95 %, bootstrap over shapes
  int rank = 0;  ///< 1 + entries that are surely better: whose interval ends before this one begins; 0: none
};
/// By entry and measure. Only entries that finished every case, with as many numbers as any other has, have
/// ranks: nobody gains by failing a hard one, or by feeling nothing there.
[[nodiscard]] std::vector<std::vector<BenchStanding>> standings_of(const BenchDocument& document);
/// Cases that the entry finished.
[[nodiscard]] std::size_t finished_by(const BenchDocument& document, const std::string& entry);

/// A table for each group, the smallest of its first median on top; last of all every case.
[[nodiscard]] std::vector<Table> bench_tables(const BenchDocument& document);
/// Losses of each entry in `document` against `other`, another seed's, case by case: tuning to the cases of
/// one seed shows here.
[[nodiscard]] Table tuning_table(const BenchDocument& document, const BenchDocument& other);

[[nodiscard]] std::string to_json(const BenchDocument& document);
/// Errors: no JSON, another schema or version of the bench, a key that is missing; standings that its rows do
/// not have.
[[nodiscard]] Result<BenchDocument> read_bench(const std::string& file);
/// Of one case.
struct CaseResult {
  CaseInputs inputs;
  std::vector<BenchRow> rows;
};

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(CaseInputs, name, shape, points, frames, points_hash, path_hash,
                                   truth_hash)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(BenchEntry, label, kind, request)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(BenchRow, entry, name, shape, reason, trace_hash, caught, lost, kicks,
                                   force_rms_percent, direction_mean_deg, force_peak_excess_percent,
                                   frame_mean_us, frame_p999_us, prepare_ms, bytes_per_point)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(CaseResult, inputs, rows)

// Palpate Bench: renderers, plug-ins and recorded traces on public or hidden cases, ranked.

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
