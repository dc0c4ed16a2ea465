# SPDX-License-Identifier: Apache-2.0
# cmake -DPAGE=page.html -DOUTPUT=file -P join_page.cmake: the page with each line "@name@" replaced by that file beside it.
file(READ ${PAGE} page)
get_filename_component(folder ${PAGE} DIRECTORY)
string(REGEX MATCHALL "@[a-z_]+\\.[a-z]+@\n" places "${page}")
foreach(place ${places})
  string(REGEX REPLACE "@|\n" "" name "${place}")
  file(READ ${folder}/${name} part)
  string(REPLACE "${place}" "${part}" page "${page}")
endforeach()
file(WRITE ${OUTPUT} "${page}")
