#include "colmap_lazyloc/options/options.h"

#include <regex>
#include <set>

#include <gmock/gmock.h>

#include "colmap_lazyloc/options/option_list.h"
#include "colmap_lazyloc/scene/errors.h"
#include "colmap_lazyloc/testing/test_folder.h"

namespace lazyloc {
namespace {

using ::testing::HasSubstr;
using ::testing::MatchesRegex;
using ::testing::ThrowsMessage;
using ::testing::internal::CaptureStdout;
using ::testing::internal::GetCapturedStdout;

constexpr size_t kMaxNumBasicOptions = 20;

class OptionsTest : public ::testing::Test {
 protected:
  static bool Parse(std::vector<std::string> words, CommandOptions* options) {
    words.insert(words.begin(), "lazy_localizer");
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    return ParseCommandLine(static_cast<int>(arguments.size()), arguments.data(), options);
  }
  // Parses the words after the required options.
  static CommandOptions Parsed(const std::vector<std::string>& words) {
    std::vector<std::string> all = {"--database_path", "a.db", "--input_path", "model", "--output_path", "out"};
    all.insert(all.end(), words.begin(), words.end());
    CommandOptions options;
    EXPECT_TRUE(Parse(all, &options));
    return options;
  }
  static std::string Help(const std::string& option) {
    CommandOptions options;
    CaptureStdout();
    EXPECT_FALSE(Parse({option}, &options));
    return GetCapturedStdout();
  }
  static std::set<std::string> OptionNames(const std::string& help) {
    std::set<std::string> names;
    const std::regex option("--([\\w.]+) arg");
    for (std::sregex_iterator match(help.begin(), help.end(), option), end; match != end; ++match) {
      names.insert((*match)[1]);
    }
    return names;
  }
  std::string WriteIni(const std::string& text) const {
    WriteBytes(folder_ / "options.ini", text);
    return folder_ / "options.ini";
  }
  static void ExpectError(const std::vector<std::string>& words, const std::string& message) {
    EXPECT_THAT([&] { Parsed(words); }, ThrowsMessage<InputError>(HasSubstr(message))) << words.back();
  }

  const TestFolder folder_;
};

TEST_F(OptionsTest, AreParsedInPlace) {
  const CommandOptions options =
      Parsed({"--LazyLocalizer.seed", "7", "--LazyLocalizer.Advanced.use_rigs", "0", "--LazyLocalizer.min_confidence",
              "0.75", "--LazyLocalizer.method", "paper", "--pairs_path", "my pairs.txt"});
  EXPECT_EQ(options.source.database_path, "a.db");
  EXPECT_EQ(options.localizer.seed, 7);
  EXPECT_FALSE(options.source.selection.groups.use_rigs);
  EXPECT_EQ(options.localizer.min_confidence, 0.75);
  EXPECT_EQ(options.localizer.method, Method::PAPER);
  EXPECT_EQ(options.source.selection.pairs_path, "my pairs.txt");
}

TEST_F(OptionsTest, IniFileOfARunIsReadAgain) {
  const CommandOptions options =
      Parsed({"--LazyLocalizer.num_retrieved", "5", "--LazyLocalizer.Advanced.rig_noise_px", "0.30000000000000004",
              "--LazyLocalizer.method", "paper", "--ImageReader.camera_params", "1,2,3,4", "--strict", "1"});
  const std::string ini = OptionsAsIni(options);
  EXPECT_THAT(ini, HasSubstr("\n[LazyLocalizer]\nnum_retrieved=5\n"));
  EXPECT_THAT(ini, HasSubstr("\n[LazyLocalizer.Advanced]\n"));
  EXPECT_EQ(ini.substr(0, ini.find('\n')),
            "# not defaults: database_path input_path output_path strict ImageReader.camera_params "
            "LazyLocalizer.num_retrieved LazyLocalizer.method LazyLocalizer.Advanced.rig_noise_px");
  CommandOptions again;
  EXPECT_TRUE(Parse({"--project_path", WriteIni(ini)}, &again));
  EXPECT_EQ(OptionsAsIni(again), ini);
  EXPECT_EQ(again.localizer.rig_noise_px, 0.30000000000000004);
}

TEST_F(OptionsTest, IniFileMayHaveDottedNames) {
  EXPECT_EQ(Parsed({"--project_path", WriteIni("LazyLocalizer.Advanced.rig_noise_px=9\n")}).localizer.rig_noise_px, 9);
  EXPECT_EQ(Parsed({"--project_path", WriteIni("[LazyLocalizer]\nAdvanced.rig_noise_px=9\n")}).localizer.rig_noise_px,
            9);
}

TEST_F(OptionsTest, CommandLineWinsOverTheIniFile) {
  EXPECT_EQ(
      Parsed({"--project_path", WriteIni("[LazyLocalizer]\nseed=3\n"), "--LazyLocalizer.seed", "4"}).localizer.seed, 4);
}

TEST_F(OptionsTest, UnknownNamesAreErrors) {
  ExpectError({"--LazyLocalizer.use_rigs", "0"}, "LazyLocalizer.use_rigs");
  ExpectError({"--project_path", WriteIni("[LazyLocalizer.Advanced]\nno_such_option=1\n")},
              "LazyLocalizer.Advanced.no_such_option");
  ExpectError({"--project_path", WriteIni("[LazyLocalizer]\nuse_rigs=1\n")}, "LazyLocalizer.use_rigs");
  ExpectError({"stray"}, "`stray` is not an option");
  ExpectError({"--databse_path", "x"},
              "colmap lazy_localizer: unknown option --databse_path; the nearest is --database_path (see");
  ExpectError({"--num_threads", "2"}, "unknown option --num_threads; the nearest is --LazyLocalizer.num_threads (see");
  ExpectError({"--LazyLocaliser.seed=2"}, "unknown option --LazyLocaliser.seed; the nearest is --LazyLocalizer.seed");
  ExpectError({"--input", "x"}, "unknown option --input; the nearest is --input_path (see");
  ExpectError({"--LazyLocalizer.use_rigs", "0"}, "; the nearest is --LazyLocalizer.Advanced.use_rigs (see");
  ExpectError({"--LazyLocalizer.epoch", "0"}, "unknown option --LazyLocalizer.epoch (see");
  ExpectError({"--epoch", "1"}, "unknown option --epoch (see colmap lazy_localizer -h)");
  CommandOptions options;
  EXPECT_THAT(
      [&] {
        Parse({"--input_path", "model"}, &options);
      },
      ThrowsMessage<InputError>("required but missing: --database_path, --output_path"));
}

TEST_F(OptionsTest, IntrinsicsAreAnEnum) {
  EXPECT_EQ(Parsed({}).localizer.intrinsics, IntrinsicsMode::AUTO);
  EXPECT_EQ(Parsed({"--LazyLocalizer.intrinsics", "given"}).localizer.intrinsics, IntrinsicsMode::GIVEN);
  ExpectError({"--LazyLocalizer.intrinsics", "exif"}, "must be one of auto, given, refine, but is 'exif'");
  ExpectError({"--LazyLocalizer.intrinsics", "refine", "--LazyLocalizer.method", "paper"},
              "option --LazyLocalizer.intrinsics = refine needs");
}

TEST_F(OptionsTest, ErrorsHaveTheFullNameOfTheOption) {
  ExpectError({"--LazyLocalizer.num_retrieved", "0"}, "option --LazyLocalizer.num_retrieved must be >= 1, but is 0");
  ExpectError({"--LazyLocalizer.num_threads", "0"}, "option --LazyLocalizer.num_threads must be >= 1, or -1");
  ExpectError({"--LazyLocalizer.Advanced.rig_noise_px", "-1"}, "option --LazyLocalizer.Advanced.rig_noise_px must be");
  ExpectError({"--LazyLocalizer.Advanced.matches_output_path", "x"},
              "option --LazyLocalizer.Advanced.matches_output_path needs --image_path");
  ExpectError({"--database_path", ""}, "database_path");
}

TEST_F(OptionsTest, SettingsAreThoseOfTheCommandLineWithoutItsOutput) {
  CommandOptions options;
  ParseSettings({{"LazyLocalizer.num_retrieved", "7"}, {"retrieval_index_path", "a=b c.index"}}, &options);
  EXPECT_EQ(options.source.num_retrieved, 7);
  EXPECT_EQ(options.source.photos.retrieval_index_path, "a=b c.index") << "needs no image_path";
  EXPECT_THAT(
      [&] {
        ParseSettings({{"LazyLocalizer.num_retrieved", "0"}}, &options);
      },
      ThrowsMessage<InputError>(HasSubstr("option --LazyLocalizer.num_retrieved must be >= 1, but is 0")));
  std::set<std::string> names;
  for (const auto& [name, text, help] : ListSettings()) names.insert(name);
  EXPECT_EQ(names.count("LazyLocalizer.num_retrieved"), 1u);
  EXPECT_EQ(names.count("output_path"), 0u);
}

TEST_F(OptionsTest, VersionIsThatOfTheProgram) { EXPECT_EQ(Help("--version"), ProgramVersion() + "\n"); }

TEST_F(OptionsTest, HelpHasTwoLevels) {
  const std::set<std::string> basic = OptionNames(Help("-h")), all = OptionNames(Help("--help-all"));
  EXPECT_LE(basic.size(), kMaxNumBasicOptions);
  EXPECT_EQ(basic.count("LazyLocalizer.min_confidence"), 1u);
  size_t num_options = 1;  // project_path
  CommandOptions options;
  ForEachOption(options, [&](const std::string& name, const auto*, const char*, OptionRole = OptionRole::METHOD) {
    ++num_options;
    EXPECT_EQ(all.count(name), 1u) << name;
  });
  EXPECT_EQ(all.size(), num_options) << "an option is there twice";
  ForEachAdvancedOption(options, [&](const std::string& name, const auto*, const char*,
                                     OptionRole = OptionRole::METHOD) { EXPECT_EQ(basic.count(name), 0u) << name; });
}

TEST(ProgramVersion, NamesBothPrograms) {
  EXPECT_THAT(ProgramVersion(), MatchesRegex("colmap_lazyloc [0-9]+\\.[0-9]+\\.[0-9]+, COLMAP [34]\\.[0-9]+.*"));
}

}  // namespace
}  // namespace lazyloc
