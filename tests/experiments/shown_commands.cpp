#include "tests/experiments/shown_commands.h"

#include <algorithm>
#include <optional>
#include <regex>
#include <set>

#include <palpate/paths.h>
#include "experiments/command/cli.h"
#include "experiments/command/subcommands.h"
#include "experiments/data/scans.h"
#include "experiments/run/arguments.h"
#include "experiments/run/stage.h"
#include "experiments/session/session.h"
#include "experiments/streams/open_stream.h"
#include "experiments/streams/stream_feed.h"
#include "experiments/tables/manifest.h"
#include "experiments/trade/measure.h"
#include "tests/house/source_tree.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

namespace fs = std::filesystem;

std::string place(const std::string& file, std::size_t line) {
  return file + ":" + std::to_string(line);
}

/// Splits text as a shell does. `line` counts from the text's first.
std::vector<ShownCommand> split(const std::string& file, std::string_view text, std::size_t line) {
  std::vector<ShownCommand> all;
  ShownCommand now{place(file, line), {}};
  std::string word;
  bool in_word = false;
  const auto end_word = [&] {
    if (in_word) now.words.push_back(word);
    word.clear();
    in_word = false;
  };
  const auto end_command = [&] {
    end_word();
    if (!now.words.empty()) all.push_back(now);
    now = {place(file, line), {}};
  };
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '\'' || c == '"') {
      in_word = true;
      for (++i; i < text.size() && text[i] != c; ++i) {
        word += text[i];
        line += text[i] == '\n';
      }
    } else if (c == '\\' && i + 1 < text.size() && text[i + 1] == '\n') {
      ++i, ++line;
    } else if (c == '#' && !in_word) {
      while (i + 1 < text.size() && text[i + 1] != '\n') ++i;
    } else if (c == '\n') {
      ++line;
      end_command();
    } else if (c == '&' && i + 1 < text.size() && text[i + 1] == '&') {
      ++i;
      end_command();
    } else if (c == ' ' || c == '\t') {
      end_word();
    } else {
      word += c;
      in_word = true;
    }
  }
  end_command();
  return all;
}

bool is_name(const std::string& word) {  // a blank to be filled in, as in --out DIR
  return std::all_of(word.begin(), word.end(), [](unsigned char c) { return std::isupper(c) || c == '_'; });
}

/// What stands behind dashes, without a value.
std::string option_of(const std::string& word) {
  return word.starts_with("-") ? word.substr(0, word.find('=')) : std::string();
}

/// Of a script of ours: every option that is given is in its own text.
std::string script_problem(const ShownCommand& command) {
  const std::string text = house::text_of(command.words.front());
  if (text.empty()) return "there is no such script";
  const bool passes_on = text.find("are passed on") != std::string::npos;
  for (std::size_t i = 1; i < command.words.size(); ++i) {
    const std::string option = option_of(command.words[i]);
    if (option.empty() || text.find(option) != std::string::npos) continue;
    if (!passes_on) return "the script knows no " + option;
    ShownCommand reproduce{command.where, {"palpate", "reproduce", "--out", "out"}};
    reproduce.words.insert(reproduce.words.end(), command.words.begin() + 1, command.words.end());
    return problem_of(reproduce);
  }
  return {};
}

/// Of CMake: presets, settings and targets that the project has.
std::string cmake_problem(const ShownCommand& command) {
  std::string text;
  for (const std::string& file : house::project_files())
    if (file.ends_with("CMakeLists.txt") || file.ends_with(".cmake") || file == "CMakePresets.json")
      text += house::text_of(file);
  const auto& words = command.words;
  for (std::size_t i = 1; i < words.size(); ++i) {
    const auto knows = [&](const std::string& what) { return text.find(what) != std::string::npos; };
    if (words[i].starts_with("-DPALPATE_")) {
      if (!knows("option(" + words[i].substr(2, words[i].find('=') - 2) + " "))
        return "no setting " + words[i];
    } else if (words[i] == "--preset" && i + 1 < words.size()) {
      if (!knows("\"name\": \"" + words[i + 1] + "\"")) return "no preset " + words[i + 1];
    } else if (words[i] == "--target" && i + 1 < words.size()) {
      std::string name = words[i + 1];
      if (name.starts_with("test_")) name = name.substr(std::string("test_").size());
      if (!knows("(" + name) && !knows(" " + name)) return "no target " + words[i + 1];
    }
  }
  return {};
}

std::string path_problem(const std::string& path) {
  const Result<NamedOptions> named = parse_named_options(path);
  if (!named) return named.error().message();
  const paths::PathGenerator* generator = paths::find_path_generator(named->name);
  if (generator == nullptr) {
    if (named->name == kPressAndSlide) {
      const auto hand = parse_press_and_slide(path);
      return hand ? "" : hand.error().message();
    }
    const std::string ending = fs::path(named->name).extension();
    if (ending.empty()) return "no path is called " + named->name;
    if (ending != ".csv" && ending != ".traj" && ending != ".palrec" && named->options.all().empty())
      return "what are the columns of " + path;
    return {};
  }
  const Result<Options> good = validate(named->options, generator->options, named->name);
  return good ? "" : good.error().message();
}

std::string model_problem(const std::string& model) {
  if (is_stream_name(model)) return {};
  if (fs::path(model).has_extension() && model.find(':') == std::string::npos) return {};
  if (find_scan(model) != nullptr) return {};
  const auto scene = scene::open_scene(model);
  return scene ? "" : scene.error().message();
}

std::string palpate_problem(const ShownCommand& command) {
  const Result<ReadLine> line = read_line({command.words.begin() + 1, command.words.end()});
  if (!line) return line.error().message();
  if (!line->answer.empty()) return {};
  const std::string& name = line->name;
  const auto given = [&](const char* option) {
    const CLI::Option* found = line->command.app->get_option_no_throw(option);
    return found == nullptr || found->count() == 0 ? std::string() : found->as<std::string>();
  };
  const render::Registry registry = all_renderers();
  if (const std::string scan = given("NAME"); name == "fetch")
    return scan.empty() || find_scan(scan) != nullptr ? "" : "no scan " + scan;
  if (const std::string tables = given("--tables"); !tables.empty())
    if (const auto manifests = manifests_for(tables); !manifests) return manifests.error().message();
  if (const std::string steps = given("--steps"); !steps.empty())
    if (const auto parsed = all_cleaning().parse(steps); !parsed) return parsed.error().message();
  for (const char* option : {"--renderer", "--renderers"})
    if (const std::string renderers = given(option); !renderers.empty() && renderers != "auto")
      if (const auto parsed = parse_renderers(renderers, registry); !parsed) return parsed.error().message();
  if (const std::string turned = given("--axes"); !turned.empty())
    if (const auto parsed = parse_axes(turned); !parsed) return parsed.error().message();
  if (const std::string path = given("--path"); !path.empty())
    if (const std::string problem = path_problem(path); !problem.empty()) return problem;
  for (const char* model : {"MODEL", "SCENE"})
    if (const std::string scene = given(model); !scene.empty())
      if (const std::string problem = model_problem(scene); !problem.empty()) return problem;
  return {};
}

/// Whether the verb or its kind has this name, a former one too.
bool is_of(const std::vector<std::string>& words, const std::string& name) {
  return words.size() > 1 && (words[1] == name || (words.size() > 2 && words[2] == name));
}

/// They are taken for one version more.
const std::set<std::string> kFormerOptions = {"--traj-columns", "--headless", "--renderer", "--hand"};

}  // namespace

std::string ShownCommand::text() const {
  return joined(words, " ");
}

std::string ShownCommand::program() const {
  return fs::path(words.front()).filename();
}

std::vector<Block> blocks_of(const std::string& file, std::string_view page, std::string_view language) {
  std::vector<Block> blocks;
  const std::string fence = "```";
  bool inside = false, ours = false;
  std::size_t line = 0;
  while (!page.empty()) {
    const std::size_t end = std::min(page.find('\n'), page.size() - 1);
    const std::string_view text = page.substr(0, end + 1);
    page.remove_prefix(end + 1);
    ++line;
    if (text.starts_with(fence)) {
      inside = !inside;
      ours = inside && text.substr(fence.size(), text.find_last_not_of("\n ") + 1 - fence.size()) == language;
      if (ours) blocks.push_back({place(file, line + 1), {}});
    } else if (ours) {
      blocks.back().text += text;
    }
  }
  return blocks;
}

std::vector<ShownCommand> commands_in_blocks(const std::string& file, std::string_view page) {
  std::vector<ShownCommand> all;
  for (const Block& block : blocks_of(file, page, "")) {
    const std::size_t line = std::stoul(block.where.substr(block.where.rfind(':') + 1));
    for (ShownCommand& command : split(file, block.text, line)) all.push_back(std::move(command));
  }
  return all;
}

const std::vector<std::string>& pages() {
  static const std::vector<std::string> all = [] {
    std::vector<std::string> found;
    for (const std::string& file : house::project_files())
      if (file == "README.md" || (file.starts_with("docs/") && file.ends_with(".md"))) found.push_back(file);
    return found;
  }();
  return all;
}

std::vector<ShownCommand> commands_of_page(const std::string& page) {
  return commands_in_blocks(page, house::text_of(page));
}

std::vector<ShownCommand> commands_in_prose(const std::string& file, std::string_view page) {
  static const std::regex kSpan(
      "`((palpate|build/release/bin/palpate|experiments/reproduce|experiments/benchmarks/real_shapes|tests/"
      "run) "
      "[^`]+)`");
  std::vector<ShownCommand> all;
  std::size_t line = 1;
  bool inside = false;
  for (std::size_t at = 0; at < page.size(); ++line) {
    const std::size_t end = std::min(page.find('\n', at), page.size());
    const std::string text(page.substr(at, end - at));
    at = end + 1;
    if (text.starts_with("```")) inside = !inside;
    if (inside) continue;
    for (std::sregex_iterator it(text.begin(), text.end(), kSpan), last; it != last; ++it)
      for (ShownCommand& command : split(file, (*it)[1].str(), line)) all.push_back(std::move(command));
  }
  return all;
}

std::string problem_of(const ShownCommand& command) {
  const std::string program = command.program();
  if (program == "palpate") return palpate_problem(command);
  if (command.words.front() == "experiments/reproduce" || command.words.front() == "tests/run")
    return script_problem(command);
  if (program == "cmake") return cmake_problem(command);
  if (program.starts_with("bench_")) return cmake_problem({command.where, {"cmake", "--target", program}});
  static const std::set<std::string> kOfTheShell = {"echo", "export", "git", "cd", "ctest"};
  return kOfTheShell.contains(program) ? ""
                                       : "what program is this? Other text stands in a block with a language";
}

std::string problem_in_prose(const ShownCommand& command) {
  if (command.program() != "palpate") return script_problem(command);
  const std::vector<std::string>& words = command.words;
  if (words.size() < 2 || words[1].starts_with("-") || is_name(words[1])) return {};
  // With a former name or today's, alone or with a kind.
  const auto former = former_names();
  const auto renewed =
      std::find_if(former.begin(), former.end(), [&](const auto& f) { return f.first == words[1]; });
  const std::string pair = words.size() > 2 ? words[1] + " " + words[2] : words[1];
  std::optional<Subcommand> named;
  bool verb = false;
  for (const Subcommand& one : all_subcommands()) {
    verb = verb || one.name.starts_with(words[1] + " ");
    if (one.name == words[1] && !named) named = one;
    if (one.name == pair || (renewed != former.end() && one.name == renewed->second)) named = one;
  }
  if (!named) return verb ? "" : "there is no command " + words[1];
  const DeclaredCommand declared = declare(*named);
  for (const std::string& word : words)
    if (const std::string option = option_of(word); !option.empty() && !option.starts_with("--help"))
      if (!kFormerOptions.contains(option) && declared.app->get_option_no_throw(option) == nullptr)
        return "there is no option " + option;
  return {};
}

std::string why_not_run(const ShownCommand& command) {
  if (command.program() == "echo") return {};
  if (command.program() != "palpate") return "builds, or is of the shell";
  for (const char* slow : {"reproduce", "behaviours", "goals", "bench"})
    if (is_of(command.words, slow)) return "takes minutes, and has tests of its own";
  for (const std::string& word : command.words)
    if (word == "--docs") return "writes the pages themselves";
  for (const std::string& word : command.words)
    if (word == "--window") return "needs a display, and stays until it is closed";
  if (command.words.size() > 1 &&
      (is_of(command.words, "live") || is_of(command.words, "record") || is_of(command.words, "study")))
    for (std::size_t i = 2; i < command.words.size(); ++i)
      if (command.words[i - 1] == "--device" && !command.words[i].starts_with("sim")) return "needs a device";
  for (const std::string& word : command.words)
    if (word.starts_with("out/reproduce")) return "reads what a run of minutes has written";
  for (const std::string& word : command.words)
    if (find_scan(word) != nullptr) return "needs a scan, or the network to fetch it";
  return {};
}

bool needs_a_process(const ShownCommand& command) {
  return is_of(command.words, "live") || is_of(command.words, "record") || is_of(command.words, "ablate") ||
         is_of(command.words, "devices");
}

std::vector<std::string> made_small(const ShownCommand& command) {
  static const std::regex kPoints("points=[0-9]+"), kFrames("frames=[0-9]+"), kWidth("width=[0-9]+"),
      kHeight("height=[0-9]+");
  std::vector<std::string> words = command.words;
  const auto given = [&](const char* option) { return std::find(words.begin(), words.end(), option); };
  const auto set = [&](const char* option, const char* value) {
    if (const auto at = given(option); at != words.end())
      at[1] = value;
    else
      words.insert(words.end(), {option, value});
  };
  for (std::size_t i = 1; i < words.size(); ++i) {
    words[i] = std::regex_replace(words[i], kPoints, "points=961");
    words[i] = std::regex_replace(words[i], kFrames, "frames=300");
    if (words[i].starts_with("sim:"))  // a camera's images
      words[i] = std::regex_replace(std::regex_replace(words[i], kWidth, "width=80"), kHeight, "height=60");
    const paths::PathGenerator* path = paths::find_path_generator(words[i].substr(0, words[i].find(':')));
    // What `paths` is given is a name to look up, and a hand is no path.
    if (path != nullptr && !is_of(words, "paths") && words[i - 1] != "--hand" &&
        words[i].find("frames=") == std::string::npos)
      words[i] += ":frames=300";
    if (words[i - 1] == "--paced") words[i] = "20";
    if (words[i - 1] == "--budget") words[i] = "2";
    if (words[i - 1] == "--max-error") words[i] = "100";  // so few points are far from the surface
  }
  if (is_of(words, "stability"))
    for (const auto& [option, value] : {std::pair{"--rates", "1000"}, {"--delays", "0"}, {"--dampings", "0"}})
      set(option, value);
  if (is_of(words, "record")) {
    if (given("--seconds") != words.end()) set("--seconds", "1");
    if (given("--accelerated") == words.end()) words.emplace_back("--accelerated");
  }
  if (is_of(words, "live") && !is_of(words, "record") && !is_of(words, "serve")) {
    set("--seconds", "0.3");
    // A machine that is busy with other tests may be late by more than the governor bears.
    if (given("--accelerated") == words.end()) words.emplace_back("--accelerated");
  }
  if (is_of(words, "sweep") || is_of(words, "tune")) words.insert(words.end(), {"--passes", "1"});
  if (is_of(words, "ablate")) set("--budget", "2");
  if (const auto observer = given("--observer");
      observer != words.end() && observer[1].starts_with("machine"))
    set("--stop-after", "2");  // it feels every trial
  if (is_of(words, "hunt")) {
    if (given("--minutes") != words.end())
      set("--minutes", "0.02");
    else
      set("--trials", "3");
  }
  return words;
}

}  // namespace palpate::experiments
