// What pages and help texts print is true: every command is understood, and runs where it can run here.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <set>

#include <palpate/scene.h>
#include "experiments/command/cli.h"
#include "experiments/command/subcommands.h"
#include "experiments/psychophysics/plan.h"
#include "experiments/report/page_figures.h"
#include "experiments/session/session.h"
#include "tests/experiments/program.h"
#include "tests/experiments/shown_commands.h"
#include "tests/house/source_tree.h"

namespace palpate::experiments {
namespace {

constexpr const char* kOnThePath = "export PATH=\"$PWD/build/release/bin:$PATH\"";

std::vector<std::string> pages() {
  std::vector<std::string> all;
  for (const std::string& file : house::project_files())
    if (file == "README.md" || (file.starts_with("docs/") && file.ends_with(".md"))) all.push_back(file);
  return all;
}

/// Every subcommand with its whole help, as a user sees it.
struct Help {
  Subcommand command;
  std::string text;
  std::vector<std::pair<std::string, std::string>> options;  ///< the name and what is said of it
};

std::vector<Help> helps() {
  std::vector<Help> all;
  for (const Subcommand& command : all_subcommands()) {
    all.push_back({command, help_text(command, true, {}), {}});
    const DeclaredCommand declared = declare(command);
    for (const CLI::Option* option : declared.app->get_options())
      all.back().options.emplace_back(option->get_name(), option->get_description());
  }
  return all;
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
                                     {"hall.pts", "3\n0 0 0\n1 0 0\n0 1 0\n"},
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
        if (const std::string out = output_of(other); !out.empty() && reads(example, out))
          check_and_run(other, all);
    check_and_run(example);
  }

 private:
  static std::string output_of(const ShownCommand& command) {
    const auto option = std::find(command.words.begin(), command.words.end(), "--out");
    return command.words.end() - option > 1 ? option[1] : std::string();
  }
  static bool reads(const ShownCommand& command, const std::string& file) {
    for (std::size_t i = 1; i < command.words.size(); ++i) {
      const std::string& word = command.words[i];
      if (command.words[i - 1] != "--out" && (word == file || word.starts_with(file + "/"))) return true;
    }
    return false;
  }

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

std::vector<ShownCommand> commands_of_page(const std::string& page) {
  return commands_in_blocks(page, house::text_of(page));
}

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
  for (const ShownCommand& command : commands_of_page(GetParam())) check_and_run(command);
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
    check_and_run(example, all);
  }
  EXPECT_TRUE(shows_itself);
}
INSTANTIATE_TEST_SUITE_P(Commands, ShownInHelp, testing::ValuesIn(names_of_commands()), kNameOfShown);

class HelpTexts : public OnCommandLine {};
class FormerNames : public OnCommandLine {};
class Completion : public OnCommandLine {};

TEST_F(HelpTexts, EveryCommandAndOptionIsDocumented) {
  std::set<std::string> names;
  for (const Help& help : helps()) {
    const std::string& name = help.command.name;
    EXPECT_TRUE(names.insert(name).second);
    EXPECT_GT(help.command.summary.size(), 10u) << name;
    for (const auto& [option, says] : help.options) {
      EXPECT_GT(says.size(), 5u) << name << " " << option;
      EXPECT_THAT(help.text, HasSubstr("  " + option)) << name << " hides " << option;
    }
  }
  EXPECT_GE(names.size(), 20u);
}

TEST_F(HelpTexts, FitAScreen) {
  const auto check = [](const std::string& help, std::size_t lines, std::size_t columns,
                        const std::string& name) {
    EXPECT_LE(static_cast<std::size_t>(std::count(help.begin(), help.end(), '\n')), lines) << name << "\n"
                                                                                           << help;
    std::istringstream text(help);
    for (std::string line; std::getline(text, line);)
      if (line.find("  palpate ") == std::string::npos) {  // an example is one line, to be copied
        EXPECT_LE(line.size(), columns) << name << ": " << line;
      }
  };
  const std::string whole = palpate("--help").out;
  check(whole, 24, kHelpColumns, "palpate");
  for (const Verb& verb : kVerbs) {
    EXPECT_THAT(whole, HasSubstr(std::string(" ") + verb.name + " ")) << verb.name;
    check(palpate(verb.name, "--help").out, 45, kHelpColumns, verb.name);
  }
  for (const Subcommand& one : all_subcommands())
    check(help_text(one, false, {}), 40, kHelpColumns, one.name);
}

TEST_F(FormerNames, StillRunAndNameTheNewOnes) {
  std::set<std::string> today;
  for (const Subcommand& one : all_subcommands()) today.insert(one.name);
  for (const auto& [old, now] : former_names()) {
    EXPECT_TRUE(today.contains(now)) << now;
    const bool list = old == "fetch" || old == "clean";
    const char* const asked = list ? "--json" : "--help";
    const ProcessOutcome run = succeeds(old, asked);
    EXPECT_THAT(run.err, HasSubstr("palpate: note: `palpate " + old + "` is now `palpate " + now + "`"));
    EXPECT_EQ(std::count(run.err.begin(), run.err.end(), '\n'), 1) << run.err;
    EXPECT_EQ(run.out, palpate(now.c_str(), asked).out) << old;
  }
}

TEST_F(FormerNames, TakeTheOptionsThatTheyHad) {
  const auto read = [](const std::vector<std::string>& words) {
    const Result<ReadLine> line = read_line(words);
    EXPECT_TRUE(line) << line.error().message();
    return line ? line->name + ": " + line->note : std::string();
  };
  EXPECT_TRUE(
      read({"replay", "plane", "--renderer=cloud", "--out", "o"}).starts_with("compare: `palpate replay`"));
  EXPECT_TRUE(read({"stability", "plane", "--hand", "finger"}).starts_with("test stability: "));
  EXPECT_TRUE(read({"record", "plane", "--hand", "arm", "--out", "a.palrec"}).starts_with("live record: "));
  EXPECT_THAT(read({"live", "plane", "--headless"}), HasSubstr("--headless"));
  EXPECT_THAT(read({"compare", "plane", "--traj-columns", "t=0,x=1", "--path", "a.txt"}),
              HasSubstr("--path a.txt:t=0:x=1"));
  EXPECT_EQ(read({"fetch", "stanford-bunny"}), "fetch: ");
  EXPECT_FALSE(read_line({"replay", "plane", "--renderer", "cloud", "--hand", "arm"}));
}

TEST_F(Completion, KnowsEveryVerbKindAndOptionAndNoFormerName) {
  const ProcessOutcome run = succeeds("completion bash");
  for (const Verb& verb : kVerbs) EXPECT_THAT(run.out, HasSubstr(verb.name)) << verb.name;
  for (const Help& help : helps()) {
    const std::size_t at = run.out.find("'" + help.command.name +
                                        (help.command.name.find(' ') == std::string::npos ? " '" : "'"));
    ASSERT_NE(at, std::string::npos) << help.command.name;
    const std::string line = run.out.substr(at, run.out.find('\n', at) - at);
    for (const auto& [option, says] : help.options)
      if (option.starts_with("--")) {
        EXPECT_THAT(line, HasSubstr(option)) << help.command.name << option;
      }
  }
  for (const char* old : {"replay", "bridge", "--headless", "--traj-columns"})
    EXPECT_THAT(run.out, Not(HasSubstr(std::string(" ") + old + " "))) << old;
  // What bash makes of it.
  const auto offered = [&](const std::string& words, int at) {
    const Result<ProcessOutcome> bash =
        run_process({"bash", "-c",
                     run.out + "COMP_WORDS=(palpate " + words + ") COMP_CWORD=" + std::to_string(at) +
                         "; _palpate; echo ${COMPREPLY[*]}"},
                    {.time_limit_s = 10.0, .folder = "."});
    return bash ? bash->out : bash.error().message();
  };
  EXPECT_EQ(offered("com", 1), "compare\n");
  EXPECT_EQ(offered("compare sw", 2), "sweep\n");
  EXPECT_EQ(offered("compare sweep x --em", 4), "--emit\n");
}

TEST_F(HelpTexts, EverySubcommandIsListedAndExplainsItself) {
  std::size_t defined = 0;
  for (const std::string& file : house::project_files())
    if (file.starts_with("experiments/command/") && file.ends_with(".cpp"))
      for (const std::string& line : house::lines_of(file)) defined += line.ends_with("_subcommand() {");
  const std::vector<Subcommand> all = all_subcommands();
  EXPECT_EQ(all.size(), defined) << "a subcommand is missing in subcommands.h";
  for (const Subcommand& one : all) {
    EXPECT_FALSE(one.examples.empty()) << one.name;
    const ProcessOutcome help = succeeds(one.name.c_str(), "--help-all");
    EXPECT_EQ(help.err, "") << one.name;
    EXPECT_THAT(help.out, HasSubstr(one.summary.substr(0, one.summary.find(' '))));
    for (const std::string& example : one.examples) {
      EXPECT_THAT(help.out, HasSubstr(example)) << one.name << ": ";
    }
  }
}

TEST_F(HelpTexts, EveryCommandIsOnSomePage) {
  std::string all;
  for (const std::string& page : pages()) all += house::text_of(page);
  for (const Help& help : helps()) {
    bool shown = all.find("palpate " + help.command.name) != std::string::npos;
    for (const auto& [old, now] : former_names())
      shown = shown || (now == help.command.name && all.find("palpate " + old) != std::string::npos);
    EXPECT_TRUE(shown) << help.command.name << " is on no page";
  }
}

TEST(Pages, CommandsInRunningTextExist) {
  std::size_t seen = 0;
  for (const std::string& page : pages())
    for (const ShownCommand& command : commands_in_prose(page, house::text_of(page))) {
      ++seen;
      EXPECT_EQ(problem_in_prose(command), "") << command.where << ": " << command.text();
    }
  EXPECT_GT(seen, 20u);
}

TEST(Pages, ShowCommandsThatRun) {
  std::size_t run = 0;
  for (const std::string& page : pages())
    for (const ShownCommand& command : commands_of_page(page)) run += why_not_run(command).empty() ? 1 : 0;
  EXPECT_GT(run, 15u) << "are the pages there?";
}

TEST(Pages, SayHowPalpateIsFound) {
  for (const std::string& page : pages()) {
    bool said = false;
    for (const ShownCommand& command : commands_of_page(page)) {
      said = said || house::text_of(page).find(kOnThePath) != std::string::npos;
      if (command.words[0] == "palpate") {
        EXPECT_TRUE(said) << command.where << ": write build/release/bin/palpate, or begin the page with "
                          << kOnThePath;
      }
    }
  }
}

TEST(Pages, ScenesOnPagesAreScenes) {
  std::size_t seen = 0;
  for (const std::string& page : pages())
    for (const Block& block : blocks_of(page, house::text_of(page), "toml")) {
      ++seen;
      if (block.text.find("\ntask =") != std::string::npos) {  // the plan of a study
        const auto plan = psychophysics::parse_plan(block.text, "page.toml", all_renderers());
        EXPECT_TRUE(plan) << block.where << ": " << (plan ? "" : plan.error().message());
        continue;
      }
      const bool whole = block.text.find("[[model]]") != std::string::npos;
      const auto scene =
          scene::parse_scene((whole ? "" : "[[model]]\ngenerate = \"plane\"\n") + block.text, "page.toml");
      EXPECT_TRUE(scene) << block.where << ": " << (scene ? "" : scene.error().message());
    }
  EXPECT_GE(seen, 3u);
}

TEST(Pages, FiguresAreWhatTheResultsSay) {
  const auto pages = pages_with_figures(PALPATE_SOURCE_ROOT);
  ASSERT_TRUE(pages) << pages.error().message();
  std::size_t blocks = 0;
  for (const PageWithFigures& page : *pages) {
    blocks += page.blocks;
    EXPECT_EQ(page.after, page.before) << page.file << ": `palpate report --docs .` writes its figures";
  }
  EXPECT_GE(blocks, 30u);
}

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

TEST(Pages, WrongCommandsAreFound) {
  const auto problem = [](const std::string& line) {
    const auto all = commands_in_blocks("page.md", "```\n" + line + "\n```\n");
    return all.size() == 1 ? problem_of(all[0]) : fmt::format("{} commands", all.size());
  };
  EXPECT_EQ(problem("palpate info plane:points=961  # a comment"), "");
  EXPECT_NE(problem("palpate inform plane"), "");
  EXPECT_NE(problem("palpate info plane --jsn"), "");
  EXPECT_NE(problem("palpate info"), "");
  EXPECT_NE(problem("palpate info plain:points=961"), "");
  EXPECT_NE(problem("palpate compare plane --renderers auto --path weav --out o"), "");
  EXPECT_NE(problem("palpate compare plane --renderers auto --path weave:depth=2 --out o"), "");
  EXPECT_NE(problem("palpate compare plane --renderers cloud:shade=none --path tap --out o"), "");
  EXPECT_NE(problem("palpate clean scan.ply --steps outlier --out o.ply"), "");
  EXPECT_NE(problem("palpate reproduce --tables 99 --out o"), "");
  EXPECT_NE(problem("palpate fetch stanford-cow"), "");
  EXPECT_NE(problem("experiments/reproduce --tabels 3"), "");
  EXPECT_NE(problem("experiments/rerun"), "");
  EXPECT_NE(problem("tests/run --stair asan"), "");
  EXPECT_NE(problem("cmake --preset fast"), "");
  EXPECT_NE(problem("cmake --preset dev -DPALPATE_WITH_CGAL=OFF"), "");
  EXPECT_NE(problem("cmake --build --preset dev --target test_nothing_at_all"), "");
  EXPECT_NE(problem("renderer -> device"), "");
  const auto two = commands_in_blocks("p.md", "text\n```\npalpate fetch \\\n  a && echo 'x\ny' > f\n```\n");
  ASSERT_EQ(two.size(), 2u);
  EXPECT_EQ(two[0].text(), "palpate fetch a");
  EXPECT_EQ(two[1].words, (std::vector<std::string>{"echo", "x\ny", ">", "f"}));
  const auto prose = [](const std::string& text) {
    const auto all = commands_in_prose("page.md", text);
    return all.empty() ? "none" : problem_in_prose(all[0]);
  };
  EXPECT_EQ(prose("see `palpate info plan SCENE` and"), "");
  EXPECT_NE(prose("see `palpate plant SCENE`"), "");
  EXPECT_NE(prose("see `palpate info plan --renderrer`"), "");
}

}  // namespace
}  // namespace palpate::experiments
