// Every command that pages and help texts show is understood and runs; pages are filled from runs.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "experiments/command/subcommands.h"
#include "tests/experiments/program.h"
#include "tests/experiments/shown_commands.h"
#include "tests/house/source_tree.h"

namespace palpate::experiments {
namespace {

/// Whether a page, one before `before` in their order, shows the same command: it runs there.
bool runs_on_a_page(const ShownCommand& command, const std::string& before = {}) {
  for (const std::string& page : pages()) {
    if (page == before) return false;
    for (const ShownCommand& other : commands_of_page(page))
      if (other.text() == command.text()) return true;
  }
  return false;
}

/// A folder with what the pages' commands speak of; they run in it.
class Shown : public OnCommandLine, public testing::WithParamInterface<std::string> {
 protected:
  Shown() : before_(std::filesystem::current_path()) {
    std::string points, grid = "ncols 31\nnrows 31\nxllcorner 0\nyllcorner 0\ncellsize 1\n";
    for (int i = 0; i < 31; ++i) {
      for (int j = 0; j < 31; ++j) {
        const double x = i - 15, y = j - 15, z = 0.02 * (x * x - y * y);
        points += fmt::format("{} {} {}\n", 1e-3 * x, 1e-3 * y, 1e-3 * z);
        grid += fmt::format("{}{}", z, j < 30 ? " " : "\n");
      }
    }
    std::string path = "t_s,x_mm,y_mm,z_mm\n";
    for (int k = 0; k < 300; ++k) path += fmt::format("{},{},1,{}\n", 1e-3 * k, 0.01 * k, 4.0 - 0.02 * k);
    std::string recorded, traj;
    for (int k = 0; k < 300; ++k)
      recorded += fmt::format("{} {} 0 {}\n", 1e-3 * k, 1e-5 * k, 4e-3 - 2e-5 * k);
    for (int k = 0; k < 300; ++k) traj += fmt::format("{} 0 {}\n", 0.01 * k, 4.0 - 0.02 * k);
    const std::string ply =
        "ply\nformat ascii 1.0\nelement vertex 961\nproperty float x\nproperty float "
        "y\nproperty float z\nend_header\n" +
        points;
    const std::string scene = "[[model]]\ngenerate = \"plane\"\npoints = 961\n";
    for (const auto& [file, text] : {std::pair{"scan.ply", ply},
                                     {"hall.pts", "961\n" + points},
                                     {"YOUR_SCAN.ply", ply},
                                     {"terrain.asc", grid},
                                     {"probe.csv", path},
                                     {"recorded.txt", recorded},
                                     {"probe.traj", traj},
                                     {"my.toml", scene},
                                     {"scan.toml", scene}})
      write_text(folder_ / file, text);
    copy_scenes();
    std::filesystem::create_directories(folder_ / "build/release/bin");
    std::filesystem::create_symlink(PALPATE_PROGRAM, folder_ / "build/release/bin/palpate");
    std::filesystem::current_path(folder_);
  }
  ~Shown() override { std::filesystem::current_path(before_); }

  /// The scenes of the tables, made small.
  void copy_scenes() const {
    std::filesystem::create_directories(folder_ / "experiments/scenes");
    for (const std::string& file : house::project_files()) {
      if (!file.starts_with("experiments/scenes/")) continue;
      std::string text;
      for (const std::string& line : house::lines_of(file))
        text += (line.starts_with("points = ") ? "points = 961" : line) + "\n";
      write_text(folder_ / file, text);
    }
  }

  /// Runs it made small; what is wrong, or nothing.
  std::string run(const ShownCommand& command) {
    std::vector<std::string> words = made_small(command);
    if (command.program() == "echo") {  // 'TEXT' > FILE
      if (words.size() != 4 || words[2] != ">") return "echo TEXT > FILE is what the test knows";
      write_text(folder_ / words[3], words[1] + "\n");
      return {};
    }
    words.erase(words.begin());
    const ProcessOutcome done = needs_a_process(command) ? palpate_process(words) : palpate_command(words);
    return done.exit_code == 0 ? "" : fmt::format("exit {}: {}", done.exit_code, done.err);
  }
  void check_and_run(const ShownCommand& command) {
    const std::string problem = problem_of(command);
    EXPECT_EQ(problem, "") << command.where << ": " << command.text();
    if (!problem.empty() || !why_not_run(command).empty()) return;
    EXPECT_EQ(run(command), "") << command.where << ": " << command.text();
  }
  /// Runs an example, and before it those that write what it reads; each once.
  void check_and_run(const ShownCommand& example, const std::vector<ShownCommand>& all) {
    if (!done_.insert(example.text()).second) return;
    if (problem_of(example).empty() && why_not_run(example).empty())
      for (const ShownCommand& other : all)
        if (is_read(other, {example})) check_and_run(other, all);
    check_and_run(example);
  }
  /// Whether one of the others is given what it writes.
  static bool is_read(const ShownCommand& command, const std::vector<ShownCommand>& others) {
    const auto option = std::find(command.words.begin(), command.words.end(), "--out");
    if (command.words.end() - option < 2) return false;
    const std::string& out = option[1];
    for (const ShownCommand& other : others)
      for (std::size_t i = 1; i < other.words.size(); ++i)
        if (other.words[i - 1] != "--out" && (other.words[i] == out || other.words[i].starts_with(out + "/")))
          return true;
    return false;
  }

 private:
  std::filesystem::path before_;
  std::set<std::string> done_;
};

/// Letters and digits of a page's or command's name.
const auto kNameOfShown = [](const testing::TestParamInfo<std::string>& shown) {
  std::string name = shown.param;
  for (char& c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
  return name;
};

std::vector<std::string> pages_with_commands() {
  std::vector<std::string> all;
  for (const std::string& page : pages())
    if (!commands_of_page(page).empty()) all.push_back(page);
  return all;
}

class ShownOnPage : public Shown {};
class ShownInHelp : public Shown {};
class Figures : public Shown {};

TEST_P(ShownOnPage, EveryCommandIsUnderstoodAndRuns) {
  const std::vector<ShownCommand> all = commands_of_page(GetParam());
  for (const ShownCommand& command : all)
    if (!runs_on_a_page(command, GetParam()) || is_read(command, all)) check_and_run(command);
}
INSTANTIATE_TEST_SUITE_P(Pages, ShownOnPage, testing::ValuesIn(pages_with_commands()), kNameOfShown);

std::vector<ShownCommand> examples_of(const Subcommand& command) {
  std::vector<ShownCommand> all;
  for (const std::string& text : command.examples)
    for (ShownCommand& example : commands_in_blocks(command.name, "```\n" + text + "\n```\n"))
      all.push_back(std::move(example));
  return all;
}

std::vector<std::string> names_of_commands() {
  std::vector<std::string> all;
  for (const Subcommand& command : all_subcommands()) all.push_back(command.name);
  return all;
}

TEST_P(ShownInHelp, EveryExampleIsUnderstoodAndRuns) {
  std::vector<ShownCommand> all, its_own;
  for (const Subcommand& command : all_subcommands()) {
    const std::vector<ShownCommand> examples = examples_of(command);
    all.insert(all.end(), examples.begin(), examples.end());
    if (command.name == GetParam()) its_own = examples;
  }
  bool shows_itself = false;
  for (const ShownCommand& example : its_own) {
    EXPECT_EQ(example.words[0], "palpate") << example.where;
    shows_itself = shows_itself || (example.text() + " ").starts_with("palpate " + GetParam() + " ");
    if (!runs_on_a_page(example)) check_and_run(example, all);
  }
  EXPECT_TRUE(shows_itself);
}
INSTANTIATE_TEST_SUITE_P(Commands, ShownInHelp, testing::ValuesIn(names_of_commands()), kNameOfShown);

TEST_F(Figures, AreWrittenFromARun) {
  const auto put = [&](const std::string& file, const std::string& text) {
    std::filesystem::create_directories((folder_ / file).parent_path());
    write_text(folder_ / file, text);
  };
  put("docs/results/deep.md", "<!-- figures: a -->\nold\n<!-- end of figures -->\n");
  put("README.md", "# Page\n<!-- figures: a -->\nold\n<!-- end of figures -->\nrest\n");
  put("docs/other.md", "no figures\n");
  put("docs/figures/a.txt",
      "<!-- from one-run.json -->\n{table7 cloud frame.mean_us µs}, {table7 cloud prepare.total_ms s}, "
      "{table7 cloud n} of {table6/neighbours.json modified_knn[dragon].points}, commit {commit}\n");
  put("run/table7/result.json",
      R"({"commit": "abc", "started_utc": "2026-01-02T03:04:05Z", "machine": {"cpu": "a cpu"}, "renderers": [)"
      R"({"label": "other", "n": 1}, {"label": "cloud", "n": 12345, "frame": {"mean_us": 0.23456},)"
      R"( "prepare": {"total_ms": 46012.5, "phases": []}}]})");
  put("run/table6/neighbours.json", R"({"modified_knn": [{"model": "dragon", "points": 437645}]})");
  const ProcessOutcome run = succeeds("report @/run --docs", folder_.string());
  EXPECT_THAT(run.out, HasSubstr("README.md"));
  EXPECT_EQ(text_in("README.md"),
            "# Page\n<!-- figures: a -->\n0.235 µs, 46 s, 12,345 of 437,645, commit abc\n<!-- end of figures "
            "-->\nrest\n");
  EXPECT_THAT(text_in("docs/results/deep.md"), HasSubstr("12,345")) << "in subfolders too";
  EXPECT_THAT(text_in("docs/figures/one-run.json"), Not(HasSubstr("phases"))) << "what is shown";
  // Again, from what was kept: nothing changes.
  EXPECT_THAT(succeeds("report --docs", folder_.string()).out, Not(HasSubstr("README.md")));
  // What a cache kept was measured on another day: nothing is taken of it.
  const std::string kept = text_in("docs/figures/one-run.json");
  put("run/table7/result.json",
      R"({"commit": "abd", "renderers": [{"label": "cloud", "n": 1, "frame": {"mean_us": 0.5},)"
      R"( "prepare": {"total_ms": 46012.5, "from_cache": true}}]})");
  refuses("--no-cache", "report @/run --docs", folder_.string());
  EXPECT_EQ(text_in("docs/figures/one-run.json"), kept);
  // A value that is not there is named with its template and line.
  put("docs/figures/a.txt", "<!-- from one-run.json -->\nfirst\n{table7 cloud frame.max_us µs}\n");
  refuses({"a.txt:3: ", "frame.max_us"}, "report --docs", folder_.string());
}

TEST_F(Figures, OfTheTrialAreTakenFromItsOwnDocument) {
  std::filesystem::create_directories(folder_ / "docs/figures");
  std::filesystem::create_directories(folder_ / "run");
  write_text(folder_ / "README.md", "<!-- figures: felt -->\n<!-- end of figures -->\n");
  // The pages of the other run are left as they are.
  write_text(folder_ / "docs/figures/one.txt", "<!-- from one-run.json -->\n{table7 cloud frame.mean_us}\n");
  write_text(folder_ / "docs/figures/felt.txt",
             "<!-- from surface.json -->\n{felt_surface.json rows[ell/cloud].summary}\n");
  write_text(folder_ / "run/felt_surface.json",
             R"({"commit": "abc", "rows": [{"label": "ell/cloud", "summary": "0.2 / 0 / 0 / -"}]})");
  const ProcessOutcome run = succeeds("report @/run --docs", folder_.string());
  EXPECT_THAT(text_in("README.md"), HasSubstr("0.2 / 0 / 0 / -\n"));
  EXPECT_THAT(text_in("docs/figures/surface.json"), HasSubstr("\"abc\""));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "docs/figures/one-run.json"));
}

}  // namespace
}  // namespace palpate::experiments
