#include <gtest/gtest.h>

#include <cstdlib>

#include "tests/toolkit/messages.h"
#include "toolkit/stream/depth_source.h"

namespace palpate::stream {
namespace {

using palpate::test::refused;

// fake_openni.cpp stands in that folder under the plug-in's name.
TEST(OpenNi, APlugInInANamedFolderOpensTheCamera) {
  ::setenv("PALPATE_PLUGINS", PALPATE_FAKE_OPENNI, 1);
  const auto source = test::value_of(open_depth_source("openni"));
  EXPECT_EQ(source->describe(), "one pixel");
  DepthFrame frame;
  ASSERT_TRUE(test::value_of(source->next(frame)));
  EXPECT_EQ(frame.depth_mm, std::vector<float>{750.0f});
  EXPECT_TRUE(refused(open_depth_source("openni:7"), "'openni:7'", "there is no camera openni:7"));
  EXPECT_TRUE(refused(open_depth_source("openni2"), "no stream 'openni2'"));
}

}  // namespace
}  // namespace palpate::stream
