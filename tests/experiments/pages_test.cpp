// What pages and help texts say is true: names, options, scenes, figures.
#include <fmt/format.h>

#include <algorithm>
#include <set>

#include <palpate/scene.h>
#include "experiments/command/cli.h"
#include "experiments/command/subcommands.h"
#include "experiments/psychophysics/trials.h"
#include "experiments/report/page.h"
#include "experiments/session/session.h"
#include "tests/experiments/program.h"
#include "tests/experiments/shown_commands.h"
#include "tests/house/source_tree.h"

namespace palpate::experiments {
namespace {

constexpr const char* kOnThePath = "export PATH=\"$PWD/build/release/bin:$PATH\"";

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

class HelpTexts : public OnCommandLine {};
class FormerNames : public OnCommandLine {};
class Completion : public OnCommandLine {};

TEST_F(HelpTexts, EveryCommandAndOptionIsDocumented) {
  std::set<std::string> names;
  for (const Help& help : helps()) {
    const std::string& name = help.command.name;
    EXPECT_TRUE(names.insert(name).second);
    EXPECT_GT(help.command.summary.size(), 10u) << name;
    EXPECT_GE(help.command.examples.size(), 2u) << name;
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
    const auto line = value_of(read_line(words));
    return line.name + ": " + line.note;
  };
  EXPECT_TRUE(
      read({"replay", "plane", "--renderer=cloud", "--out", "o"}).starts_with("compare: `palpate replay`"));
  EXPECT_TRUE(read({"stability", "plane", "--hand", "finger"}).starts_with("test stability: "));
  EXPECT_TRUE(read({"record", "plane", "--hand", "arm", "--out", "a.palrec"}).starts_with("live record: "));
  EXPECT_THAT(read({"live", "plane", "--headless"}), HasSubstr("--headless"));
  EXPECT_THAT(read({"compare", "plane", "--traj-columns", "t=0,x=1", "--path", "a.txt"}),
              HasSubstr("--path a.txt:t=0:x=1"));
  EXPECT_EQ(read({"fetch", "stanford-bunny"}), "fetch: ");
  // Options that choose a kind.
  EXPECT_EQ(read({"info", "plane:points=441", "--plan"}), "info plan: ");
  EXPECT_EQ(read({"compare", "plane", "--vary", "rate,precision", "--passes=2"}), "compare sweep: ");
  EXPECT_EQ(read({"compare", "sweep", "plane", "--vary=rate"}), "compare sweep: ");
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
    for (const std::string& example : one.examples)
      EXPECT_THAT(help.out, HasSubstr(example)) << one.name << ": ";
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
    for (const ShownCommand& command : commands_of_page(page)) run += why_not_run(command).empty();
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
  const auto pages = value_of(pages_with_figures(PALPATE_SOURCE_ROOT));
  std::size_t blocks = 0;
  for (const PageWithFigures& page : pages) {
    blocks += page.blocks;
    EXPECT_EQ(page.after, page.before) << page.file << ": `palpate report --docs .` writes its figures";
  }
  EXPECT_GE(blocks, 30u);
}

TEST(Pages, WrongCommandsAreFound) {
  const auto problem = [](const std::string& line) {
    const auto all = commands_in_blocks("page.md", "```\n" + line + "\n```\n");
    return all.size() == 1 ? problem_of(all[0]) : fmt::format("{} commands", all.size());
  };
  EXPECT_EQ(problem("palpate info plane:points=961  # a comment"), "");
  for (const char* wrong :
       {"palpate inform plane", "palpate info plane --jsn", "palpate info", "palpate info plain:points=961",
        "palpate compare plane --renderers auto --path weav --out o",
        "palpate compare plane --renderers auto --path weave:depth=2 --out o",
        "palpate compare plane --renderers cloud:shade=none --path tap --out o",
        "palpate clean scan.ply --steps outlier --out o.ply", "palpate reproduce --tables 99 --out o",
        "palpate fetch stanford-cow", "experiments/reproduce --tabels 3", "experiments/rerun",
        "tests/run --stair asan", "cmake --preset fast", "cmake --preset dev -DPALPATE_WITH_CGAL=OFF",
        "cmake --build --preset dev --target test_nothing_at_all", "renderer -> device"})
    EXPECT_NE(problem(wrong), "") << wrong;
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
