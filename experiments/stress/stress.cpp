#include "experiments/stress/stress.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include <palpate/clock.h>
#include <palpate/result.h>
#include "experiments/driver/suite.h"

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
      return Error{fmt::format("there is no case '{}'", word), "choose cases or whole groups from " + known};
    }
  std::erase_if(all, [&](const StressCase& one) {
    const bool named =
        std::any_of(words.begin(), words.end(), [&](const std::string& w) { return names_it(one, w); });
    return (!words.empty() && !named) || (arguments.quick && !one.quick);
  });
  if (all.empty())
    return Error{"none of these cases is of the short set", "leave out --quick, or name others"};
  return all;
}

Result<std::vector<RendererRequest>> chosen_renderers(const std::string& text,
                                                      const render::Registry& registry) {
  if (!text.empty()) return parse_renderers(text, registry);
  std::vector<RendererRequest> requests;
  for (const render::RendererInfo& info : registry.all()) {
    if (info.geometry == render::Geometry::kImages) continue;  // no case has a camera
    requests.push_back({info.name, info.name, {}, {}});
    // Adds the world frame, where single precision holds the file's coordinates.
    if (info.name != kShownInBothFrames) continue;
    Options world;
    world.set("frame", "world");
    requests.push_back({std::string(kShownInBothFrames) + "-world", info.name, std::move(world), {}});
  }
  return requests;
}

/// Runs the rows and keeps complete ones.
class StressRun {
 public:
  StressRun(const StressArguments& arguments, const render::Registry& registry, const Suite& suite,
            StressMatrix& matrix)
      : arguments_(arguments), registry_(registry), suite_(suite), matrix_(matrix) {
    limits_.seconds = arguments.cell_s;
    for (const StressCase& one : matrix.cases)
      if (!one.full || arguments.full) run_.push_back(one);
  }

  Status all() {
    for (std::size_t r = 0; r < matrix_.renderers.size(); ++r) {
      const RendererRequest& request = matrix_.renderers[r];
      suite_.progress().set_prefix(fmt::format("[{}/{}] ", r + 1, matrix_.renderers.size()));
      std::vector<StressCell> row;
      if (!suite_.take(request.label, key_of(request), row) && !spent() &&
          suite_.measures(untimed(request))) {
        run_row(request, r, row);
        if (row.size() == run_.size()) PALPATE_TRY(suite_.keep(request.label, key_of(request), row));
      }
      matrix_.cells.push_back(spread(request, row));
    }
    suite_.progress().set_prefix("");
    return Done{};
  }

 private:
  [[nodiscard]] bool spent() const {
    return arguments_.budget_s > 0.0 && !suite_.partial() && watch_.ms() > 1e3 * arguments_.budget_s;
  }

  void run_row(const RendererRequest& request, std::size_t r, std::vector<StressCell>& row) {
    const auto say = [&] {
      if (row.size() == run_.size()) return;
      const double done =
          static_cast<double>(r) + static_cast<double>(row.size()) / static_cast<double>(run_.size());
      suite_.progress().report(fmt::format("{} at the extremes", request.label),
                               done / static_cast<double>(matrix_.renderers.size()));
    };
    say();
    run_row_apart(run_, request, registry_, limits_, [&](StressCell&& cell) {
      row.push_back(std::move(cell));
      say();
      return !spent();
    });
  }

  /// Expands a row by the cells not run.
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
  const Suite& suite_;
  StressMatrix& matrix_;
  CellLimits limits_;
  std::vector<StressCase> run_;  ///< the cases run
  Stopwatch watch_;
};

}  // namespace

Result<int> run_stress(const StressArguments& arguments, Context& context) {
  Suite suite(context);
  const render::Registry registry = all_renderers();
  StressMatrix matrix;
  PALPATE_ASSIGN(matrix.renderers, chosen_renderers(arguments.renderers, registry));
  for (const RendererRequest& request : matrix.renderers)
    matrix.roles.push_back(registry.find(request.name)->role);
  PALPATE_ASSIGN(matrix.cases, chosen_cases(arguments));
  matrix.head = new_head(context.command_line);
  std::optional<OtherHashes> other;
  if (!arguments.against.empty()) {
    PALPATE_ASSIGN(other, read_hashes(arguments.against));
  }
  PALPATE_TRY(suite.open(arguments.out));
  RunKey key;
  key.add(arguments.cases).add(arguments.cell_s);
  key.add(static_cast<std::uint64_t>(arguments.full)).add(static_cast<std::uint64_t>(arguments.quick));
  PALPATE_TRY(suite.begin(key));
  PALPATE_TRY(StressRun(arguments, registry, suite, matrix).all());
  if (suite.partial()) return suite.leave();
  SuiteResults results{kStressFile, stress_json(matrix), {stress_table(matrix), stress_summary(matrix)}};
  Page page = stress_page(matrix);
  bool short_of = failures(matrix, render::Role::kOurs) > 0;
  if (other) {
    const std::vector<HashRow> rows = compare_hashes(matrix, *other);
    results.json = with_hashes(results.json, rows, *other);
    results.tables.push_back(hash_table(rows, *other));
    page.sections.front().tables.push_back(results.tables.back());
    short_of = short_of || std::any_of(rows.begin(), rows.end(), [](const HashRow& row) {
                 return row.role == render::Role::kOurs && !row.different.empty();
               });
  }
  PALPATE_TRY(suite.folder().write("stress.svg", stress_picture(matrix)));
  PALPATE_TRY(suite.publish(results, page, arguments.json));
  return short_of ? kExitFellShort : kExitOk;
}

}  // namespace palpate::experiments
