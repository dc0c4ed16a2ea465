# SPDX-License-Identifier: Apache-2.0
# cmake -DGIT=program -DVERSION=1.2.3 -DINPUT=version.cpp.in -DOUTPUT=version.cpp -P version.cmake, in the sources' folder and in
# every build: the file is written only where the revision is another, so that nothing else is made anew.
set(REVISION unknown)
if(GIT)
  execute_process(COMMAND ${GIT} describe --always --dirty --abbrev=12 OUTPUT_VARIABLE described OUTPUT_STRIP_TRAILING_WHITESPACE
                  ERROR_QUIET)
  if(described)
    set(REVISION ${described})
  endif()
endif()
configure_file(${INPUT} ${OUTPUT} @ONLY)
