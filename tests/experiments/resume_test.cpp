// Every command that takes long goes on where it was killed: a case that is kept is not done again.

#include <algorithm>
#include <nlohmann/json.hpp>

#include "experiments/session/session.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

/// A command that is killed once `part` is kept, or the record that it is holds `text`. Then `text` in it
/// becomes `marked`: only a run that goes on from it shows kMark in `document`.
const char* const kMark = "987654";
struct Killed {
  const char* name;
  std::string line;
  const char *part, *text, *marked, *document;
};

std::vector<Killed> killed_commands() {
  return {
      {"compare",
       std::string("compare ") + kTinyWaves + " --renderers cloud,cloud-literal,brute-force --path " +
           kTinyWeave,
       ".palpate-parts/cloud", R"(\"reason\": null)", R"(\"reason\": \"987654\")", "result.json"},
      {"behaviours", "test behaviours --renderers cloud,cloud-literal,brute-force --only thin-plate,hovering",
       ".palpate-parts/cloud", R"("failure":"")", R"("failure":"987654")", "behaviours.json"},
      {"stress", "test stress --renderers cloud,brute-force,penalty-grid --cases one-point,scale-unit",
       ".palpate-parts/cloud", R"("cause":"")", R"("cause":"987654")", "stress.json"},
      {"stability",
       std::string("test stability ") + kTinyWaves + " --renderers cloud --path " + kTinyWeave +
           " --rates 1000 --delays 0 --dampings 0",
       ".palpate-parts/truth", R"("control":"none")", R"("control":"987654")", "stability.json"},
      {"goals", "test goals --quick", ".palpate-parts/one-machine", R"("about":")", R"("about":"987654 )",
       "goals.json"},
      {"hunt", "test hunt --renderers cloud,heightfield --minutes 0.06", ".palpate-parts/cloud",
       R"("faulty":0)", R"("faulty":987654)", "hunt.json"},
      {"ablate",
       std::string("compare ablate ") + kTinyWaves +
           " --renderer cloud --friction 0.7,0.5 --deformation 0.2 --path " + kTinyWeave + " --budget 0",
       ".palpate-parts/1", R"("instead":")", R"("instead":"987654 )", "ablate.json"},
      {"sweep",
       std::string("compare sweep ") + kTinyWaves +
           " --renderers cloud,cloud-literal --axes rate,precision --path " + kTinyWeave +
           " --passes 2 --budget 10",
       "rows.jsonl", R"("reason":"")", R"("reason":"987654")", "sweep.json"},
      {"tune",
       std::string("tune ") + kTinyWaves +
           " --renderers cloud,cloud-literal --axes rate,precision --max-error 50 --path " + kTinyWeave +
           " --passes 2 --budget 10",
       "rows.jsonl", R"("reason":"")", R"("reason":"987654")", "sweep.json"},
      {"bench", "test bench --quick --entry cloud", ".palpate-parts/bent-comb-even", R"("reason":"")",
       R"("reason":"987654")", "bench.json"},
      // The mark becomes digits of the seconds before the first answer.
      {"study", "study abx --observer machine --stop-after 12", "trials.csv", ",2,1,0.500,",
       "987654,2,1,0.500,", "trials.csv"}};
}

class GoesOn : public OnCommandLine, public testing::WithParamInterface<Killed> {};

TEST_P(GoesOn, WhereItWasKilled) {
  const Killed& killed = GetParam();
  const Words line = words(killed.line.c_str(), "--out @/out");
  const std::string part = in("out/" + std::string(killed.part));
  {
    Started run(folder_, line);
    const bool is_record = killed.part[0] != '.';
    ASSERT_TRUE(run.wait_for([&] {
      return file_text(part).find(is_record ? killed.text : "{") != std::string::npos;
    })) << run.err();
    run.send(SIGKILL);
    ASSERT_NE(run.end(), 0) << "it was done before it was killed";
  }
  std::string text = file_text(part);
  apart_ = true;
  refuses("remove this folder",
          "compare plane:points=441 --renderers cloud --path tap:frames=300 --out @/out");
  EXPECT_EQ(file_text(part), text) << "of another command";
  json kept = json::parse(text, nullptr, false);
  const bool wrapped = kept.is_object() && kept.contains("text");
  if (wrapped) text = kept["text"];
  const std::size_t at = text.find(killed.text);
  ASSERT_NE(at, std::string::npos) << text.substr(0, 2000);
  text.replace(at, std::string(killed.text).size(), killed.marked);
  if (wrapped) kept["text"] = text;
  write_text(part, wrapped ? kept.dump() : text);
  const ProcessOutcome next = palpate_process(line);
  EXPECT_LE(next.exit_code, 1) << next.err;
  EXPECT_NE(next.err.find("going on from an interrupted run"), std::string::npos) << next.err;
  EXPECT_LE(std::count(next.out.begin(), next.out.end(), '\n'), 15) << "all that is printed: " << next.out;
  EXPECT_FALSE(std::filesystem::exists(in("out/.palpate-parts")));
  EXPECT_NE(file_text(in("out/" + std::string(killed.document))).find(kMark), std::string::npos)
      << "the case was done again: " << next.err;
}

INSTANTIATE_TEST_SUITE_P(Commands, GoesOn, testing::ValuesIn(killed_commands()),
                         [](const auto& killed) { return killed.param.name; });

}  // namespace
}  // namespace palpate::experiments
