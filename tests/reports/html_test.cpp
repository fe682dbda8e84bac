#include "reports/html.h"

#include <gtest/gtest.h>

namespace fringecal::reports {
namespace {

TEST(Html, EscapesEveryCharacterThatMeansSomethingInMarkup) {
  EXPECT_EQ(text("<script>alert(\"1\" & '2')</script>").html(),
            "&lt;script&gt;alert(&quot;1&quot; &amp; &#39;2&#39;)&lt;/script&gt;");
  EXPECT_EQ(element("a", {{"title", "\"><b onclick='x'>"}}, text("y")).html(),
            "<a title=\"&quot;&gt;&lt;b onclick=&#39;x&#39;&gt;\">y</a>");
}

TEST(Html, KeepsUmlautsAndChinese) { EXPECT_EQ(text("Prüfkörper 陈 µm 𝜃").html(), "Prüfkörper 陈 µm 𝜃"); }

TEST(Html, ShowsBytesThatAreNotUtf8AsReplacementCharacters) {
  EXPECT_EQ(text("a\xff"
                 "b")
                .html(),
            "a\uFFFDb");
  EXPECT_EQ(text("\xc0\xaf").html(), "\uFFFD\uFFFD");            // an overlong slash
  EXPECT_EQ(text("\xed\xa0\x80").html(), "\uFFFD\uFFFD\uFFFD");  // a surrogate
  EXPECT_EQ(text("\xe9\x99").html(), "\uFFFD\uFFFD");            // a truncated character
  EXPECT_EQ(text(std::string_view("a\0b\x1b", 4)).html(), "a\uFFFDb\uFFFD");
}

TEST(Html, GroupsTheHeadingsOfNeighbouringColumns) {
  const std::string html =
      table("", {{"a", "", ""}, {"b", "", "ours"}, {"c", "", "ours"}}, {{text("1"), text("2"), text("3")}}).html();
  EXPECT_NE(html.find("<th colspan=\"2\" class=\"group\">ours</th>"), std::string::npos) << html;
}

TEST(Html, RefusesATableRowOfTheWrongLength) {
  EXPECT_THROW(table("", {{"a", "", ""}, {"b", "", ""}}, {{text("1")}}), std::logic_error);
}

TEST(Html, SetsThePowersOfAUnit) {
  EXPECT_EQ(unit("mm^-2").html(), "mm<sup>−2</sup>");
  EXPECT_EQ(unit("px").html(), "px");
}

TEST(Html, EncodesBase64AsTheStandardsExamples) {  // RFC 4648, section 10
  EXPECT_EQ(base64(""), "");
  EXPECT_EQ(base64("f"), "Zg==");
  EXPECT_EQ(base64("fo"), "Zm8=");
  EXPECT_EQ(base64("foo"), "Zm9v");
  EXPECT_EQ(base64("foobar"), "Zm9vYmFy");
  EXPECT_EQ(base64("\xff\xfe\xfd"), "//79");
}

}  // namespace
}  // namespace fringecal::reports
