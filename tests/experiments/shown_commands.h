// Commands as pages and help texts show them: found, checked without being run, and made small to be run.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace palpate::experiments {

struct ShownCommand {
  std::string where;  ///< "docs/tutorials/first-touch.md:12"
  std::vector<std::string> words;

  [[nodiscard]] std::string text() const;
  /// The program without its folder: "palpate", "cmake", ..
  [[nodiscard]] std::string program() const;
};

/// README.md and the pages of docs, in their order.
[[nodiscard]] const std::vector<std::string>& pages();
/// Those of the fenced blocks that name no language, as a shell would split them: quotes, comments, lines
/// that go on after a backslash, &&.
[[nodiscard]] std::vector<ShownCommand> commands_in_blocks(const std::string& file, std::string_view page);
[[nodiscard]] std::vector<ShownCommand> commands_of_page(const std::string& page);
/// `palpate ..`, `experiments/reproduce ..` and `tests/run ..` in running text; they may be cut short.
[[nodiscard]] std::vector<ShownCommand> commands_in_prose(const std::string& file, std::string_view page);
/// The blocks of a language, "toml", with the line of each.
struct Block {
  std::string where, text;
};
[[nodiscard]] std::vector<Block> blocks_of(const std::string& file, std::string_view page,
                                           std::string_view language);

/// What is wrong with a whole command, by what the programs understand; empty: nothing. Files need not be
/// there.
[[nodiscard]] std::string problem_of(const ShownCommand& command);
/// The same for one in running text, of which only the command and the names of options are looked at.
[[nodiscard]] std::string problem_in_prose(const ShownCommand& command);

/// Why a command is not run; empty where it is.
[[nodiscard]] std::string why_not_run(const ShownCommand& command);
/// Whether it is run in a process of its own: it starts itself again, or has threads in real time.
[[nodiscard]] bool needs_a_process(const ShownCommand& command);
/// The same command with few points, frames, pixels and trials.
[[nodiscard]] std::vector<std::string> made_small(const ShownCommand& command);

}  // namespace palpate::experiments
