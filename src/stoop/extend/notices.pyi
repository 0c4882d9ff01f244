from stoop.base.notices import Value as Value
from stoop.base.notices import as_notice as as_notice
from stoop.base.notices import attempt as attempt
from stoop.base.notices import distinct as distinct
from stoop.base.notices import from_dict as from_dict
from stoop.base.notices import notice as notice
from stoop.base.notices import of_severity as of_severity
from stoop.base.notices import paragraph as paragraph
