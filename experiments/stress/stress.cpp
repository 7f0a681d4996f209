#include "experiments/stress/stress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <optional>

#include "experiments/session/run_key.h"
#include "experiments/session/terminal.h"
#include "experiments/stress/against.h"
#include "experiments/stress/apart.h"
#include "experiments/stress/matrix.h"
#include "toolkit/core/clock.h"
#include "toolkit/core/try.h"

namespace palpate::experiments {
namespace {

constexpr const char* kShownInBothFrames = "mesh-godobject";

bool names_it(const StressCase& one, const std::string& word) {
  return one.name == word || one.group == word;
}

Result<std::vector<StressCase>> chosen_cases(const StressArguments& arguments) {
  std::vector<StressCase> all = stress_cases();
  const std::vector<std::string> words =
      arguments.cases.empty() ? std::vector<std::string>() : split_list(arguments.cases);
  for (const std::string& word : words)
    if (std::none_of(all.begin(), all.end(), [&](const StressCase& one) { return names_it(one, word); })) {
      std::string known, group;
      for (const StressCase& one : all) {
        if (one.group != group) {
          known += (group.empty() ? "" : ", ") + one.group + " (";
          group = one.group;
        }
        known += one.name + (&one == &all.back() || (&one + 1)->group != group ? ")" : " ");
      }
      return Error{
          fmt::format("there is no case '{}'", word), "choose cases or whole groups from " + known, {}, 0};
    }
  std::erase_if(all, [&](const StressCase& one) {
    const bool named =
        std::any_of(words.begin(), words.end(), [&](const std::string& w) { return names_it(one, w); });
    return (!words.empty() && !named) || (arguments.quick && !one.quick);
  });
  if (all.empty())
    return Error{"none of these cases is of the short set", "leave out --quick, or name others", {}, 0};
  return all;
}

Result<std::vector<RendererRequest>> chosen_renderers(const std::string& text,
                                                      const render::Registry& registry) {
  if (!text.empty()) return parse_renderers(text, registry);
  std::vector<RendererRequest> requests;
  for (const render::RendererInfo& info : registry.all()) {
    requests.push_back({info.name, info.name, {}, {}});
    // Beside its local frame, what single precision makes of coordinates as the file has them.
    if (info.name != kShownInBothFrames) continue;
    Options world;
    world.set("frame", "world");
    requests.push_back({std::string(kShownInBothFrames) + "-world", info.name, std::move(world), {}});
  }
  return requests;
}

std::string row_text(const std::vector<StressCell>& row) {
  std::string text;
  for (const StressCell& cell : row) text += to_line(cell) + "\n";
  return text;
}
bool row_of(const std::string& text, std::size_t cells, std::vector<StressCell>& row) {
  row.clear();
  for (const std::string& line : split_list(text, '\n'))
    if (!line.empty() && !from_line(line, row.emplace_back())) return false;
  return row.size() == cells;
}

/// Runs the rows and keeps each that is complete.
class StressRun {
 public:
  StressRun(const StressArguments& arguments, const render::Registry& registry, const OutputFolder& folder,
            StressMatrix& matrix, ProgressBar& progress)
      : arguments_(arguments), registry_(registry), folder_(folder), matrix_(matrix), progress_(progress) {
    limits_.seconds = arguments.cell_s;
    for (const StressCase& one : matrix.cases)
      if (!one.full || arguments.full) run_.push_back(one);
  }

  Status all() {
    for (std::size_t r = 0; r < matrix_.renderers.size(); ++r) {
      const RendererRequest& request = matrix_.renderers[r];
      progress_.set_prefix(fmt::format("[{}/{}] ", r + 1, matrix_.renderers.size()));
      std::vector<StressCell> row;
      const bool kept = folder_.take_over(request.label, key_of(request), [&](const std::string& text) {
        return row_of(text, run_.size(), row);
      });
      if (!kept && !spent()) {
        row.clear();
        run_row(request, r, row);
        if (row.size() == run_.size())
          PALPATE_TRY(folder_.keep(request.label, key_of(request), row_text(row)));
      }
      matrix_.cells.push_back(spread(request, row));
    }
    progress_.set_prefix("");
    return Done{};
  }

 private:
  [[nodiscard]] bool spent() const {
    return arguments_.budget_s > 0.0 && watch_.ms() > 1e3 * arguments_.budget_s;
  }

  void run_row(const RendererRequest& request, std::size_t r, std::vector<StressCell>& row) {
    const auto say = [&] {
      if (row.size() == run_.size()) return;
      const double done =
          static_cast<double>(r) + static_cast<double>(row.size()) / static_cast<double>(run_.size());
      progress_.report(fmt::format("{} at the extremes", request.label),
                       done / static_cast<double>(matrix_.renderers.size()));
    };
    say();
    run_row_apart(run_, request, registry_, limits_, [&](StressCell&& cell) {
      row.push_back(std::move(cell));
      say();
      return !spent();
    });
  }

  /// The row with the cells that were not run.
  std::vector<StressCell> spread(const RendererRequest& request, const std::vector<StressCell>& row) const {
    std::vector<StressCell> cells;
    for (const StressCase& one : matrix_.cases) {
      const auto at =
          std::find_if(row.begin(), row.end(), [&](const StressCell& c) { return c.name == one.name; });
      StressCell skipped;
      skipped.renderer = request.label;
      skipped.name = one.name;
      skipped.cause = one.full && !arguments_.full ? "only with --full" : "the budget was spent";
      cells.push_back(at != row.end() ? *at : skipped);
    }
    return cells;
  }

  const StressArguments& arguments_;
  const render::Registry& registry_;
  const OutputFolder& folder_;
  StressMatrix& matrix_;
  ProgressBar& progress_;
  CellLimits limits_;
  std::vector<StressCase> run_;  ///< those that are run
  Stopwatch watch_;
};

/// What stands in the folder, and what is printed.
struct StressResults {
  std::string json;
  std::vector<Table> tables;
  bool short_of = false;  ///< a cell of ours is red, or answers other bits than it should
};

StressResults results_of(const StressMatrix& matrix, const std::optional<OtherHashes>& other) {
  StressResults results{stress_json(matrix),
                        {stress_table(matrix), stress_summary(matrix)},
                        failures(matrix, render::Role::kOurs) > 0};
  if (!other) return results;
  const std::vector<HashRow> rows = compare_hashes(matrix, *other);
  results.json = with_hashes(results.json, rows, *other);
  results.tables.push_back(hash_table(rows, *other));
  for (const HashRow& row : rows)
    results.short_of = results.short_of || (row.role == render::Role::kOurs && !row.different.empty());
  return results;
}

Status write_results(const StressMatrix& matrix, const StressResults& results, const OutputFolder& folder) {
  PALPATE_TRY(folder.write(kStressFile, results.json));
  PALPATE_TRY(folder.write("stress.svg", stress_picture(matrix)));
  Page page = stress_page(matrix);
  if (results.tables.size() > 2) page.sections.front().tables.push_back(results.tables.back());
  PALPATE_TRY(write_page(page, folder));
  return folder.complete();
}

}  // namespace

int run_stress(const StressArguments& arguments, Context& context) {
  const render::Registry registry = all_renderers();
  StressMatrix matrix;
  Result<std::vector<RendererRequest>> renderers = chosen_renderers(arguments.renderers, registry);
  if (!renderers) return fail(renderers.error(), kExitBadInput);
  matrix.renderers = *std::move(renderers);
  for (const RendererRequest& request : matrix.renderers)
    matrix.roles.push_back(registry.find(request.name)->role);
  Result<std::vector<StressCase>> cases = chosen_cases(arguments);
  if (!cases) return fail(cases.error(), kExitBadInput);
  matrix.cases = *std::move(cases);
  matrix.head = new_head(context.command_line);
  std::optional<OtherHashes> other;
  if (!arguments.against.empty()) {
    Result<OtherHashes> read = read_hashes(arguments.against);
    if (!read) return fail(read.error(), kExitBadInput);
    other = *std::move(read);
  }
  const Result<OutputFolder> folder = OutputFolder::open(arguments.out);
  if (!folder) return fail(folder.error(), kExitBadInput, &context.progress);
  RunKey key;
  key.add(arguments.cases).add(arguments.cell_s);
  key.add(static_cast<std::uint64_t>(arguments.full)).add(static_cast<std::uint64_t>(arguments.quick));
  if (const Status begun = begin_run(*folder, key.word(), context); !begun)
    return fail(begun.error(), kExitFellShort, &context.progress);
  Status done = StressRun(arguments, registry, *folder, matrix, context.progress).all();
  const StressResults results = results_of(matrix, other);
  if (done) done = write_results(matrix, results, *folder);
  context.progress.clear();
  if (!done) return fail(done.error(), kExitFellShort);
  if (arguments.json) {
    fmt::print("{}", results.json);
  } else {
    for (const Table& table : results.tables)
      fmt::print("{}\n", to_text(table, terminal_columns(STDOUT_FILENO)));
    fmt::print("report: {}\n", std::filesystem::absolute(folder->file("report.html")).string());
  }
  return results.short_of ? kExitFellShort : kExitOk;
}

}  // namespace palpate::experiments
