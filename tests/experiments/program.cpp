#include "tests/experiments/program.h"

#include "experiments/command/cli.h"
#include "tests/json_schema.h"

namespace palpate::experiments {
namespace {

constexpr unsigned kLimitS = 120;

}  // namespace

ProcessOutcome palpate_command(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), PALPATE_PROGRAM);
  std::vector<const char*> argv;
  for (const std::string& one : arguments) argv.push_back(one.c_str());
  std::string thrown;
  const auto on_pipe = std::signal(SIGPIPE, SIG_IGN);  // as the program does
  ::alarm(kLimitS);                                    // ends the test
  ProcessOutcome outcome = captured([&] {
    try {
      return run_command_line(static_cast<int>(argv.size()), argv.data());
    } catch (const std::exception& error) {
      thrown = error.what();
      return -1;
    }
  });
  ::alarm(0);
  std::signal(SIGPIPE, on_pipe);
  EXPECT_EQ(thrown, "");
  return outcome;
}

ProcessOutcome palpate_process(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), PALPATE_PROGRAM);
  Result<ProcessOutcome> run = run_process(arguments, {.time_limit_s = kLimitS});
  if (!run) {
    ADD_FAILURE() << run.error().message();
    return {};
  }
  EXPECT_FALSE(run->timed_out);
  return *std::move(run);
}

ProcessOutcome OnCommandLine::run_line(const Words& line) const {
  return apart_ ? palpate_process(line) : palpate_command(line);
}

ProcessOutcome OnCommandLine::ends_with(int status, const Says& says, const Words& line) const {
  ProcessOutcome run = run_line(line);
  EXPECT_EQ(run.exit_code, status) << testing::PrintToString(line) << "\n" << run.err;
  for (const std::string& one : says) EXPECT_THAT(run.err, HasSubstr(one)) << testing::PrintToString(line);
  return run;
}

void OnCommandLine::expect_valid(const std::string& name, const std::string& document) {
  EXPECT_EQ(schema_violations(std::string(PALPATE_DOCS) + "/schemas/" + name + ".schema.json", document), "");
}

void OnCommandLine::add(Words& all, const char* part) const {
  std::istringstream text(part);
  for (std::string word; text >> word;) {
    for (std::size_t at = word.find('@'); at != std::string::npos; at = word.find('@', at))
      word.replace(at, 1, folder_.string()), at += folder_.string().size();
    all.push_back(std::move(word));
  }
}

}  // namespace palpate::experiments
